"""Whatever is handed to a front door of sim, it is taken or refused as SimulationError: never another error."""

from collections.abc import Callable

import numpy as np
import pytest

import sim
from sim.errors import SimulationError

HOSTILE = (
    None,
    "a",
    float("nan"),
    float("inf"),
    -1,
    0,
    [],
    (),
    np.zeros((3, 3)),
    np.full(3, np.nan),
    1e300,
    b"a",
    {},
    1j,
)
ROOM = sim.room((1.0, 1.0, 1.0), 0.5)
FACTORS = sim.form_factors(ROOM)
LENS = sim.Lens.from_horizontal_field_of_view(8, 6, 100.0)
POSE = sim.Pose.look_at((0.5, 0.5, 0.5), (1, 1, 0))
TRANSPORT = sim.coaxial_transport(ROOM, FACTORS, LENS, POSE)
TARGET = np.full(48, 0.2)
TRIANGLE = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]

DOORS: dict[str, Callable[[object], object]] = {
    "room: size": lambda bad: sim.room(bad, 0.5),
    "room: length": lambda bad: sim.room((bad, 1, 1), 0.5),
    "room: patch size": lambda bad: sim.room((1, 1, 1), bad),
    "room: reflectance": lambda bad: sim.room((1, 1, 1), 0.5, bad),
    "room: reflectance of a face": lambda bad: sim.room((1, 1, 1), 0.5, {"floor": bad}, faces=("floor",)),
    "room: faces": lambda bad: sim.room((1, 1, 1), 0.5, faces=bad),
    "paper_room: patch size": lambda bad: sim.paper_room(patch_size_m=bad),
    "room_with_box: patch size": sim.room_with_box,
    "room_with_box: box": lambda bad: sim.room_with_box(box_size_m=bad),
    "room_with_box: corner": lambda bad: sim.room_with_box(box_corner_m=bad),
    "form_factors: surface": sim.form_factors,
    "form_factors: method": lambda bad: sim.form_factors(ROOM, bad),
    "form_factors: visibility": lambda bad: sim.form_factors(ROOM, visibility=bad),
    "Radiosity: reflectance": lambda bad: sim.Radiosity(FACTORS, bad),
    "Radiosity: emission": lambda bad: sim.Radiosity(FACTORS, 0.5).solve(bad),
    "Lens: width": lambda bad: sim.Lens.from_horizontal_field_of_view(bad, 6, 100.0),
    "Lens: field of view": lambda bad: sim.Lens.from_horizontal_field_of_view(8, 6, bad),
    "Pose: position": lambda bad: sim.Pose.look_at(bad, (1, 1, 0)),
    "Pose: roll": lambda bad: sim.Pose.look_at((0, 0, 1), (1, 1, 0), roll_deg=bad),
    "Mesh: corners": lambda bad: sim.Mesh.from_arrays("m", bad, [(0, 1, 2)], 0.5),
    "Mesh: polygons": lambda bad: sim.Mesh.from_arrays("m", TRIANGLE, bad, 0.5),
    "Mesh: reflectance": lambda bad: sim.Mesh.from_arrays("m", TRIANGLE, [(0, 1, 2)], bad),
    "plan: surface": lambda bad: sim.plan(bad, 5),
    "plan: tolerance": lambda bad: sim.plan(ROOM, bad),
    "plan: light": lambda bad: sim.plan(ROOM, 5, bad),
    "plan: reflectances": lambda bad: sim.plan(ROOM, 50, reflectances=bad),
    "plan: memory": lambda bad: sim.plan(ROOM, 50, memory_limit_mb=bad),
    "compensate: name": lambda bad: sim.compensate(bad, TRANSPORT, TARGET),
    "compensate: transport": lambda bad: sim.compensate("exact", bad, TARGET),
    "compensate: target": lambda bad: sim.compensate("exact", TRANSPORT, bad),
    "compensate: lower": lambda bad: sim.compensate("exact", TRANSPORT, TARGET, bad),
    "coaxial_transport: scene": lambda bad: sim.coaxial_transport(bad, FACTORS, LENS, POSE),
}
TAKEN = {
    ("room: reflectance", 0),
    ("room: reflectance of a face", 0),
    ("Radiosity: reflectance", 0),
    ("Mesh: reflectance", 0),
    ("plan: reflectances", None),
    ("plan: memory", 1e300),
    ("compensate: lower", -1),
    ("compensate: lower", 0),
    ("Pose: roll", -1),
    ("Pose: roll", 0),
    ("Pose: roll", 1e300),
}
"""What is a good argument after all."""


@pytest.mark.parametrize("door", DOORS)
def test_a_front_door_takes_or_refuses_in_its_own_words(door: str) -> None:
    for bad in HOSTILE:
        words = repr(bad)
        if any(name == door and type(good) is type(bad) and good == bad for name, good in TAKEN):
            DOORS[door](bad)
            continue
        with pytest.raises(SimulationError, match=r"\w{3}") as caught:
            DOORS[door](bad)
        assert type(caught.value) is SimulationError, words
