"""A whole session of the command line on real drivers: `rig emulate` beside `rig run`, and a cable pulled meanwhile.

The camera is what most people have first: a webcam of 8 bits whose tone curve is that of sRGB.
"""

import json
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from rig.devices.kms.readback import Readback
from rig.files.journal import JOURNAL_NAME
from rig.profile.schema import load_profile
from rig.session import Session
from rig.session.timing import seconds_by_step
from tests.contract.lab import load_module

pytestmark = pytest.mark.timeout(1700)
RIG = (sys.executable, "-m", "rig")
PULLED_AFTER_FRAMES = 30
PICTURE = (480, 640)
STRATEGIES = "none,bounded"
"""Without compensation and with the best one: in an emulated machine each other one is half a minute."""


def frames(session: Path) -> int:
    """How many are on disk."""
    journal = session / JOURNAL_NAME
    return journal.read_text().count('"event": "frame"') if journal.exists() else 0


def pull_the_cable(emulated: subprocess.Popen[str], session: Path, ended: threading.Event) -> None:
    """In the middle of the patterns; and put it back."""
    while frames(session) < PULLED_AFTER_FRAMES and not ended.is_set():
        ended.wait(0.2)
    for command in ("unplug", "plug"):
        emulated.stdin.write(f"{command}\n")
        emulated.stdin.flush()
        ended.wait(2.0)


WEBCAM = {
    'pixel_format = "Y12"': 'pixel_format = "GREY"',
    "bit_depth = 12": "bit_depth = 8",
    "compression = 0.08": 'tone = "srgb"',
    "width_px = 480\nheight_px = 360": "width_px = 320\nheight_px = 240",
    "focal_px = 199.39": "focal_px = 132.93",
    "principal_point_px = [241.3, 176.9]": "principal_point_px = [160.9, 117.9]",
}
"""Of 320 by 240 pixels: the session's work is the emulated machine's time, half of what it was with 480 by 360."""


def webcam(folder: Path) -> Path:
    """The profile `emulated-rig` with a webcam's camera."""
    text = load_profile("emulated-rig").path.read_text("utf-8")
    for old, new in WEBCAM.items():
        assert old in text
        text = text.replace(old, new)
    path = folder / "webcam.toml"
    path.write_text(text, "utf-8")
    return path


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, subprocess.CompletedProcess[str]]:
    load_module("vkms")
    folder = tmp_path_factory.mktemp("runs")
    session, profile = folder / "emulated", str(webcam(folder))
    command = [*RIG, "emulate", "-p", profile, "--json"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as emulated:
        found = json.loads(emulated.stdout.readline())
        assert found["device_id"] == "usb-1209:0001-EMULATED1"
        ended = threading.Event()
        hand = threading.Thread(target=pull_the_cable, args=(emulated, session, ended))
        hand.start()
        done = subprocess.run(
            [*RIG, "run", str(session), "-p", profile, "--strategies", STRATEGIES, "--json"],
            capture_output=True,
            text=True,
            check=False,
        )
        ended.set()
        hand.join()
        emulated.stdin.write("quit\n")
        emulated.stdin.flush()
    print(done.stderr)
    print({step: round(seconds, 1) for step, seconds in seconds_by_step(Session.read(session)).items()})
    return session, done


def test_it_ends_within_its_limits_with_a_report(run: tuple[Path, subprocess.CompletedProcess[str]]) -> None:
    session, done = run
    assert done.returncode == 0, done.stdout + done.stderr
    metrics = json.loads(done.stdout)
    print({key: metrics[key] for key in ("geometry", "truth", "comparison", "measured", "elapsed_s")})
    assert metrics["within_limits"]
    assert (session / "report.html").stat().st_size > 100_000


def test_compensation_gains_in_the_room_behind_the_drivers(
    run: tuple[Path, subprocess.CompletedProcess[str]],
) -> None:
    measured = json.loads(run[1].stdout)["measured"]
    assert measured["compensated"]["mean"] < 0.3 * measured["uncompensated"]["mean"]


def test_calibration_finds_the_lenses_of_the_room_behind_the_drivers(
    run: tuple[Path, subprocess.CompletedProcess[str]],
) -> None:
    truth = json.loads(run[1].stdout)["truth"]
    assert truth["camera_position_mm"] < 5
    assert truth["focal_percent"] < 1
    assert truth["reflectance_rmse"] < 0.06


def test_the_pulled_cable_is_noted_and_no_frame_is_missing_or_doubled(
    run: tuple[Path, subprocess.CompletedProcess[str]],
) -> None:
    events = [json.loads(line) for line in (run[0] / JOURNAL_NAME).read_text().splitlines()]
    kinds = {event["note"]["event"] for event in events if event["event"] == "note"}
    assert {"unplugged", "replugged"} <= kinds
    names = [(event["step"], event["name"]) for event in events if event["event"] == "frame"]
    assert len(names) == len(set(names)) > PULLED_AFTER_FRAMES


def test_afterwards_the_display_has_no_picture_of_ours(run: tuple[Path, subprocess.CompletedProcess[str]]) -> None:
    """The kernel shows its console again, in its own size, where it has one."""
    readback = Readback("Virtual-1")
    readback.open()
    assert readback.frame_id() == 0 or readback.shape() != PICTURE or not readback.picture().any()
    readback.close()
