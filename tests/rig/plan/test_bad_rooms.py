"""Rooms that cannot be are refused with what is wrong, against which limit, and what to try."""

from pathlib import Path
from typing import Any

import pytest

from rig.cli.app import run_command
from rig.errors import ProfileError, RigError, UsageError
from rig.plan.compute import plan_room
from rig.plan.request import load_room, request_of
from rig.plan.run import room_file
from tests.rig.plan.rooms import PLAIN, projector, room

NO_LUMENS = {key: value for key, value in PLAIN["projector"].items() if key != "lumens"}
WINDOW = {"name": "window", "surface": "x0", "from_m": [1, 1], "to_m": [2, 2]}
BAD: list[tuple[dict[str, Any], str]] = [
    ({"projector": projector(throw_ratio=0.05)}, r"168.6 degrees wide; no lens does that"),
    ({"projector": projector(lens_shift=[0, 50])}, r"lens_shift.*more than 2 picture sizes; give shares"),
    (
        {"projector": projector(position_m=[5.5, 1, 1])},
        r"position_m: \(5.5, 1, 1\) m is not in the air.*0 \.\.\. 4.8",
    ),
    ({"projector": projector(position_m=[4.8, 1, 1])}, r"in or behind a wall"),
    ({"projector": projector(look_at_m=[1.2, 1.2, 1.2])}, r"the aim is at the lens"),
    ({"projector": projector(model="no such")}, r"projector.model: 'no such': no facts are known.*Optoma"),
    ({"projector": NO_LUMENS | {"model": "HD20"}}, r"projector.lumens: missing.*Optoma HD20"),
    ({"viewer": [{"name": "guest", "eye_m": [1, 1, 9]}]}, r"viewer guest: \(1, 1, 9\) m is not in the air"),
    ({"person": [{"name": "guest", "at_m": [9, 1]}]}, r"person guest: .* outside of the room, x 0 \.\.\. 4.8"),
    ({"person": [{"name": "guest", "at_m": [1.2, 1.3]}]}, r"person guest: stands where the projector is"),
    ({"paint": {"all": "clasic-gray"}}, r"paint.all: no paint is called 'clasic-gray'; did you mean classic-gray\?"),
    ({"paint": {"all": 70}}, r"a reflectance of 70; .* 70 % is 0.7"),
    ({"paint": {"all": 1.0}}, r"0.001 \.\.\. 0.99"),
    ({"paint": {"all": "munsell-n12"}}, r"from N0.5 to N9.75"),
    ({"paint": {"walls": 0.5}}, r"nothing is said of floor"),
    ({"paint": {"all": 0.5, "x9": 0.5}}, r"paint.x9: the room has no such surface; there are floor"),
    ({"opening": [{**WINDOW, "to_m": [2, 3]}]}, r"opening window: .* x0, which is 4.8 x 2.4 m"),
    ({"opening": [WINDOW, {**WINDOW, "name": "door"}]}, r"overlaps opening door"),
    ({"opening": [{**WINDOW, "name": "floor"}]}, r"something else has this name"),
    ({"room": {"scene": "castle"}}, r"room.scene: 'castle' is not known; there are paper-room"),
    ({"room": {"size_m": [48, 48, 24], "patch_m": 0.2}}, r"a plan takes 6000; give a larger room.patch_m"),
    ({"show": {"white_cdm2": 20, "pictures": ["nothing.png"]}}, r"'nothing.png' is neither a file nor one of outdoor"),
    ({"show": {"white_cdm2": 20, "pictures": ["grey:7"]}}, r"give a share of white, e.g. grey:0.5"),
    ({"show": {"white_cdm2": 20, "strategies": ["magic"]}}, r"unknown strategy magic; there are none, direct"),
    (
        {"projector": projector(height_px=16)},
        r"a picture of \d+ x 16 pixels is .* as wide as high; projectors have",
    ),
    ({"projector": projector(look_at_m=[1.2, 1.2, 1.200001])}, r"the aim is at the lens"),
    (
        {"viewer": [{"name": "guest", "eye_m": [2, 2, 0.1], "stands": True}]},
        r"viewer guest: stands.*person of 0.22 m",
    ),
    ({"person": [{"name": "guest", "at_m": [3, 1], "height_m": 2.5}]}, r"person guest: 2.5 m high in a room of 2.4 m"),
]
TWO = [{"name": "one", "eye_m": [2, 2, 1.6]}, {"name": "one", "eye_m": [3, 2, 1.6]}]
UNREADABLE: list[tuple[dict[str, Any], str]] = [
    ({"projector": NO_LUMENS}, r"projector.lumens: missing; give the lumens of white, or a model"),
    ({"show": {"pictures": ["grey"]}}, r"show.white_cdm2: missing; .* 48 as in a cinema"),
    ({"room": {"size_m": [1, 1, 1], "scene": "corner"}}, r"size_m and scene given; give one"),
    ({"room_light": {"lux": 1, "lamp_lm": 1}}, r"room_light: lux and lamp_lm"),
    ({"room": {"scene": "corner"}, "opening": [WINDOW]}, r"opening: known in a box only"),
    ({"projector": projector(throwratio=1)}, r"projector.throwratio: unknown key; did you mean throw_ratio"),
    ({"room": {"size_m": [0, 1, 1]}}, r"room.size_m.0: is 0, should be greater than or equal to 0.1"),
    ({"room": {"size_m": [4.8, 4.8, 2.4], "patch_m": 5}}, r"room.patch_m: 5 m is longer than the room \(4.8 m\)"),
    ({"room": {"size_m": [4.8, 4.8, 2.4], "patch_m": 1e-9}}, r"room.patch_m: is 1e-09, should be .* 0.02"),
    ({"projector": projector(lumens=1e9)}, r"projector.lumens: is 1000000000.0, should be less .* 200000"),
    ({"projector": projector(width_px=10**9)}, r"projector.width_px: is 1000000000, should be less .* 16384"),
    ({"projector": projector(position_m=[1e300, 1, 1])}, r"projector.position_m.0: is 1e\+300, should be less"),
    ({"room_light": {"lux": 1e9}}, r"room_light.lux: .* 200000"),
    ({"show": {"white_cdm2": 1e9}}, r"show.white_cdm2: .* 10000"),
    ({"show": {"white_cdm2": 20, "pictures": ["a/x.png", "b/x.png"]}}, r"show.pictures: x.png is there twice"),
    ({"person": [{"name": "giant", "at_m": [3, 1], "height_m": 50}]}, r"person.height_m: is 50, should be less .* 2.8"),
    ({"viewer": TWO}, r"viewer.one.name: is there twice; give each its own"),
    (
        {"named_paint": [{"name": "w", "reflectance": 0.8}, {"name": "w", "reflectance": 0.4}]},
        r"named_paint.w.name",
    ),
]


def words_of(value: object) -> str:
    return value[:40] if isinstance(value, str) else ""


@pytest.mark.parametrize(("change", "words"), BAD, ids=words_of)
def test_a_room_that_cannot_be_is_refused_in_words(change: dict[str, Any], words: str) -> None:
    with pytest.raises(UsageError, match=words):
        plan_room(room(**change))


@pytest.mark.parametrize(("change", "words"), UNREADABLE, ids=words_of)
def test_a_file_that_says_too_little_or_too_much_is_refused_in_words(change: dict[str, Any], words: str) -> None:
    with pytest.raises(ProfileError, match=words):
        request_of({**PLAIN, **change})


def test_a_file_that_is_not_there_names_the_rooms_that_are(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="lecture-room, paper-room, three-walls, where-to-stand"):
        room_file(tmp_path / "room.toml")
    with pytest.raises(RigError, match="cannot be read"):
        load_room(tmp_path)


def test_the_command_ends_with_status_2_and_says_why(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "room.toml").write_text("schema = 1\n[room]\nsize_m = [1.0, 1.0, 1.0]\n")
    assert run_command(["plan", str(tmp_path / "room.toml")]) == 2
    assert "projector: missing" in capsys.readouterr().err


def test_a_key_that_is_missing_is_told_once_with_what_to_write() -> None:
    with pytest.raises(ProfileError) as refused:
        request_of({key: value for key, value in PLAIN.items() if key != "show"} | {"show": {"pictures": ["grey"]}})
    lines = [line for line in str(refused.value).splitlines() if "show.white_cdm2: missing" in line]
    assert len(lines) == 1
    assert "say how bright white shall look" in lines[0]
