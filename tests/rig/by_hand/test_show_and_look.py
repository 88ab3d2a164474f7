"""Showing and looking by hand, on the command line: what is held, who ends it, and what a photograph is worth."""

from __future__ import annotations

import json
import os
import pty
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from rig.by_hand.look import LookRequest, look
from rig.by_hand.photograph import figures_of
from rig.by_hand.pictures import PATTERNS, picture_named, spots_of
from rig.cli.app import run_command
from rig.devices.protocols import RawFrame
from rig.devices.simulated.display import ClockedDisplay
from rig.errors import UsageError
from rig.files.pictures import read_codes, write_png
from rig.profile.schema import Profile

ROOT = Path(__file__).parents[3]
TINY = (ROOT / "hw_profiles" / "ci-tiny.toml").read_text("utf-8").replace("cell_size_m = 0.2", "cell_size_m = 0.6")
Capture = pytest.CaptureFixture[str]


@pytest.fixture
def shown(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Pictures that the simulated display was given, and "closed" when it was let go."""
    seen: list[Any] = []
    was_shown, was_closed = ClockedDisplay.show, ClockedDisplay.close
    monkeypatch.setattr(
        ClockedDisplay, "show", lambda self, codes, *, name: (seen.append(codes), was_shown(self, codes, name=name))[1]
    )
    monkeypatch.setattr(ClockedDisplay, "close", lambda self: (seen.append("closed"), was_closed(self))[1])
    return seen


@pytest.mark.parametrize("name", [*PATTERNS, "spots"])
def test_each_pattern_is_held_for_its_time_and_black_comes_last(
    name: str, shown: list[Any], capsys: Capture, tiny_profile: Profile
) -> None:
    assert run_command(["show", name, "-p", "ci-tiny", "--seconds", "0.05", "--json"]) == 0
    held, end = shown
    assert np.array_equal(held, picture_named(name, tiny_profile).codes)
    assert end == "closed"
    result = json.loads(capsys.readouterr().out)
    assert result["ended_by"] == "time over"
    assert (result["width_px"], result["height_px"]) == (256, 192)


def test_spots_are_those_of_the_tape_step_and_say_what_to_write(shown: list[Any], capsys: Capture) -> None:
    assert run_command(["show", "spots", "-p", "ci-tiny", "--seconds", "0.05"]) == 0
    codes = shown[0]
    assert codes[75, 37] == codes[75, 217] == 255
    assert codes[75, 127] == 0
    assert "spots_px = [[37, 75], [217, 75]]" in capsys.readouterr().err


def test_a_profile_without_spots_is_offered_two_inside_the_picture() -> None:
    text = TINY.replace('projector = "projector"\nspots_px = [[37, 75], [217, 75]]\ndistance_m = 4.876', "")
    text = text.replace("[[scale]]", '[[scale]]\nbetween = ["camera", "projector"]\nbaseline_m = 0.6')
    profile = Profile.parse(text.encode(), Path("lab.toml"))
    assert spots_of(profile) == ((38.0, 77.0), (218.0, 77.0))
    assert picture_named("spots", profile).codes[77, 38] == 255


def test_stars_are_finest_in_the_middle_and_stripes_are_as_wide_as_they_say(tiny_profile: Profile) -> None:
    shape = tiny_profile.projector.shape
    stripes = PATTERNS["stripes"](shape)
    for k, period in enumerate((2, 4, 8, 16)):
        band = stripes[0, 64 * k : 64 * (k + 1)].astype(int)
        assert np.array_equal(band[: period // 2], np.repeat(band[0], period // 2))
        assert np.array_equal(band[:-period], band[period:])
    star = PATTERNS["focus"](shape)[:64, :85]
    changes = [(np.diff(star[32 - r : 33 + r, 42 - r : 43 + r].astype(int), axis=1) != 0).mean() for r in (5, 30)]
    assert changes[0] > 1.3 * changes[1]


def test_a_file_is_shown_as_it_is_and_another_size_only_when_asked(
    shown: list[Any], capsys: Capture, tmp_path: Path
) -> None:
    codes = np.random.default_rng(1).integers(0, 256, (192, 256, 3), np.uint8)
    write_png(tmp_path / "own.png", codes)
    write_png(tmp_path / "other.png", codes[:96, :128])
    assert run_command(["show", str(tmp_path / "own.png"), "-p", "ci-tiny", "--seconds", "0.05"]) == 0
    assert np.array_equal(shown[0], codes)
    assert run_command(["show", str(tmp_path / "other.png"), "-p", "ci-tiny", "--seconds", "0.05"]) == 2
    assert "add --fit" in capsys.readouterr().err
    assert run_command(["show", str(tmp_path / "other.png"), "-p", "ci-tiny", "--seconds", "0.05", "--fit"]) == 0
    assert shown[-2].shape == (192, 256, 3)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["show", "nothing.png", "-p", "ci-tiny"], "the patterns are white, black, grid"),
        (["show", "white", "-p", "ci-tiny", "--seconds", "nan"], "no time to show"),
        (["show", "white", "-p", "nowhere"], "no such profile"),
        (["look", "-p", "ci-tiny", "--exposure", "9"], "outside the camera's 0.0001 … 2 s"),
        (["look", "-p", "ci-tiny", "--seconds", "2"], "belongs to --watch"),
        (["look", "-p", "ci-tiny", "--watch", "--seconds", "-1"], "no time to watch"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_opens(words: list[str], message: str, capsys: Capture) -> None:
    assert run_command(words) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize("how", ["q", "SIGINT", "SIGTERM"])
def test_a_held_picture_ends_with_q_or_a_signal(how: str) -> None:
    master, slave = pty.openpty()
    command = [sys.executable, "-m", "rig", "show", "grid", "-p", "ci-tiny", "--json"]
    show = subprocess.Popen(
        command, stdin=slave, stdout=subprocess.PIPE, stderr=slave, text=True, start_new_session=True,
        preexec_fn=lambda: os.close(os.open(os.ttyname(slave), os.O_RDWR)),
    )  # fmt: skip
    seen = b""
    while b"ends it" not in seen:
        seen += os.read(master, 4096)
    os.write(master, b"q") if how == "q" else show.send_signal(getattr(signal, how))
    out, _ = show.communicate(timeout=60)
    os.close(master)
    os.close(slave)
    assert show.returncode == 0
    assert json.loads(out)["ended_by"] == ("key q" if how == "q" else how)


@pytest.fixture(scope="module")
def blurred(tmp_path_factory: pytest.TempPathFactory) -> dict[float, str]:
    """Profiles of the small rig by the blur of its projector, in pixels."""
    folder = tmp_path_factory.mktemp("blurred")
    files = {}
    for blur_px in (0.3, 1.0, 2.5):
        files[blur_px] = str(folder / f"blur-{blur_px}.toml")
        text = TINY.replace("s_shape = 0.25\nblur_px = 0.5", f"s_shape = 0.25\nblur_px = {blur_px}")
        Path(files[blur_px]).write_text(text, encoding="utf-8")
    return files


def test_a_sharper_lens_has_the_higher_figure(blurred: dict[float, str]) -> None:
    values = [look(LookRequest(profile=path)).figures.sharpness for path in blurred.values()]
    assert all(value is not None for value in values)
    assert values == sorted(values, reverse=True)
    assert values[0] > 1.2 * values[-1]


def test_noise_is_not_taken_for_sharpness() -> None:
    """Soft blobs under more noise than they have steps: the figure is that of the blobs."""
    draw = np.random.default_rng(7)
    blobs = cv2.resize(draw.uniform(600, 3000, (24, 32)), (320, 240), interpolation=cv2.INTER_CUBIC)[..., None]
    frames = [raw_frame(blobs + draw.normal(0, 200, blobs.shape)) for _ in range(2)]
    quiet = figures_of(raw_frame(blobs), raw_frame(blobs), 4095).sharpness
    noisy, fooled = figures_of(frames[0], frames[1], 4095).sharpness, figures_of(frames[0], frames[0], 4095).sharpness
    assert quiet is not None
    assert noisy == pytest.approx(quiet, rel=0.05)
    assert fooled is not None
    assert fooled > 2 * quiet


def raw_frame(levels: NDArray[np.float64]) -> RawFrame:
    pixels = np.rint(levels).astype(np.uint16)
    return RawFrame(pixels=pixels, exposure_s=0.01, started_s=0.0, sequence=1)


def test_a_look_writes_the_photograph_and_says_what_is_clipped(
    capsys: Capture, blurred: dict[float, str], tmp_path: Path
) -> None:
    words = ["look", "-p", blurred[1.0], "--show", "white", "--exposure", "0.2", "-o", str(tmp_path / "look.png")]
    assert run_command([*words, "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    figures = result["figures"]
    assert sum(figures["histogram"]) == pytest.approx(1)
    assert figures["clipped_share"] > 0.3
    photograph = read_codes(tmp_path / "look.png")
    assert photograph.shape == (240, 320, 3)
    assert (photograph.max(axis=2) == 255).mean() == pytest.approx(figures["clipped_share"], abs=0.05)
    assert run_command(words) == 0
    assert "give a shorter --exposure" in capsys.readouterr().out


def test_a_dark_photograph_has_no_sharpness(capsys: Capture, blurred: dict[float, str], tmp_path: Path) -> None:
    words = ["look", "-p", blurred[1.0], "--exposure", "0.0001", "-o", str(tmp_path / "look.png")]
    assert run_command(words) == 0
    out = capsys.readouterr().out
    assert "too dark to say how sharp it is" in out
    assert "give a longer --exposure" in out


def test_watching_tells_the_best_so_far(capsys: Capture, blurred: dict[float, str]) -> None:
    assert run_command(["look", "-p", blurred[1.0], "--watch", "--seconds", "0.2", "--json"]) == 0
    captured = capsys.readouterr()
    result = json.loads(captured.out)
    assert result["looks"] >= 1
    assert result["best"] >= result["last"] > 0
    assert "best so far" in captured.err


def test_a_recording_can_neither_show_nor_look(tmp_path: Path) -> None:
    text = TINY.split("[simulation]")[0].replace('driver = "simulated"', 'driver = "replay"')
    (tmp_path / "replay.toml").write_text(text + '\n[replay]\nsession = "runs/x"\n', encoding="utf-8")
    assert run_command(["show", "white", "-p", str(tmp_path / "replay.toml"), "--seconds", "0.1"]) == 2
    with pytest.raises(UsageError, match="a recording"):
        look(LookRequest(profile=str(tmp_path / "replay.toml")))
