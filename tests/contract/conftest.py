"""Every back end that the contract suites run over, made small.

PROCAM_DEVICE_LAB_BACK_ENDS, a list with commas, names others instead: those of `lab.py`, on real kernel drivers.
"""

import os
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest

from rig.capture.rig import Rig, open_rig
from rig.devices.protocols import Codes
from rig.profile.schema import Profile
from rig.session import Session
from tests.gige import GigeRig, gige_rig, needs_aravis, plugged
from tests.still import StillRig, needs_gphoto2, still_rig

LEVELS = {"white": 255, "black": 0, "level-128": 128}
"""Pictures that every back end can show."""
OWN = ("simulated", "session", "photographs")
NEEDS = {"gige": needs_aravis, "still": needs_gphoto2}
BACK_ENDS = [
    pytest.param(name, marks=[NEEDS[name]]) if name in NEEDS else name
    for name in os.environ.get("PROCAM_DEVICE_LAB_BACK_ENDS", ",".join((*OWN, *NEEDS))).split(",")
]


def flat_codes(rig: Rig, name: str) -> Codes:
    return np.full(rig.projector.shape, LEVELS[name], np.uint8)


def replaying(profile: Profile, table: str, folder: Path) -> Profile:
    """The same devices, from a recording."""
    text = profile.raw.decode()
    text = text[: text.index("[simulation]")].replace('driver = "simulated"', 'driver = "replay"')
    path = folder / "replay-profile.toml"
    path.write_text(f"{text}\n[replay]\n{table}\n")
    return Profile.parse(path.read_bytes(), path)


@pytest.fixture(scope="session")
def simulated(tiny_profile: Profile) -> Profile:
    text = tiny_profile.raw.decode().replace("stale_frame_rate = 0.02", "stale_frame_rate = 0.0")
    return Profile.parse(text.encode(), tiny_profile.path)


@pytest.fixture(scope="session")
def recorded_session(simulated: Profile, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recorded") / "session"
    with open_rig(simulated) as rig, Session.open(folder, simulated) as session:
        step = session.step("flat")
        for name in ("white", "black", "level-128", "white"):
            frame = rig.shoot(flat_codes(rig, name), name=name)
            step.save_frame(f"{name}.{len(step.frame_names)}", frame, pattern=name)
        longer = rig.shoot(flat_codes(rig, "white"), name="white", exposure_s=0.04)
        step.save_frame("white-longer", longer, pattern="white")
        step.finish()
    return folder


@pytest.fixture(scope="session")
def photographs(simulated: Profile, recorded_session: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A manifest and 16-bit PNG photographs of the flat pictures."""
    folder = tmp_path_factory.mktemp("photographs")
    with Session.open(recorded_session) as session:
        step = session.finished("flat")
        for name in LEVELS:
            frame = step.load_frame(next(n for n in step.frame_names if n.startswith(f"{name}.")))
            cv2.imwrite(str(folder / f"{name}.png"), frame.pixels)
    lines = [f'{name} = "{name}.png"' for name in LEVELS]
    camera, projector = simulated.camera, simulated.projector
    (folder / "replay.toml").write_text(
        f"schema = 1\n[camera]\nwidth_px = {camera.width_px}\nheight_px = {camera.height_px}\n"
        f"full_scale_dn = {camera.full_scale_dn}\n"
        f"[projector]\nwidth_px = {projector.width_px}\nheight_px = {projector.height_px}\n"
        "[frames]\n" + "\n".join(lines)
    )
    return folder / "replay.toml"


@pytest.fixture(scope="session")
def back_ends(
    simulated: Profile, recorded_session: Path, photographs: Path, tmp_path_factory: pytest.TempPathFactory
) -> dict[str, Profile]:
    folder = tmp_path_factory.mktemp("replay")
    return {
        "simulated": simulated,
        "session": replaying(simulated, f'session = "{recorded_session}"', folder),
        "photographs": replaying(simulated, f'manifest = "{photographs}"', folder),
    }


@pytest.fixture(scope="session")
def gige() -> GigeRig:
    return gige_rig()


@pytest.fixture(scope="session")
def still(tmp_path_factory: pytest.TempPathFactory) -> Iterator[StillRig]:
    found = still_rig(tmp_path_factory.mktemp("still"))
    with found.camera:
        yield found


@pytest.fixture(params=BACK_ENDS)
def open_back_end(request: pytest.FixtureRequest) -> Iterator[Callable[[], Rig]]:
    if request.param == "gige":
        with plugged(request.getfixturevalue("gige")) as gige:
            yield partial(open_rig, gige.profile)
    elif request.param == "still":
        yield partial(open_rig, request.getfixturevalue("still").profile)
    elif request.param in OWN:
        yield partial(open_rig, request.getfixturevalue("back_ends")[request.param])
    else:
        from tests.contract import lab

        yield lab.BACK_ENDS[request.param]


@pytest.fixture
def flat() -> Callable[[Rig, str], Codes]:
    """Codes of a flat picture that every back end can show: white, black or level-128."""
    return flat_codes


@pytest.fixture
def rig(open_back_end: Callable[[], Rig]) -> Iterator[Rig]:
    with open_back_end() as rig:
        yield rig


@pytest.fixture
def show(rig: Rig) -> Callable[[str], float]:
    """Show a flat picture; returns when its light has settled."""

    def show(name: str) -> float:
        shown = rig.projector.show(flat_codes(rig, name), name=name)
        return shown.on_screen_s + rig.profile.projector.latency_s

    return show
