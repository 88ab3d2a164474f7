"""Sessions with devices that change pictures on their own: what televisions, webcams, rooms and lenses do to them.

    python benchmarks/calibration/meddling_devices.py
    python benchmarks/calibration/meddling_devices.py --profile hw_profiles/sim-room.toml --only stray "at frame"

The simulated devices of a profile, each time with one of the changes below: picture modes of projectors, automatics of
cameras, stray light in lenses, lights that are switched on, a tripod that gives way. A line a session: whether it ended
within its limits, how far it is from the truth, or why it was refused. None may end within its limits and far from the
truth; whether a refusal names the true cause a person has to read.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import sys
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any
from unittest import mock

import cv2
import numpy as np
from numpy.typing import NDArray
from varied_profiles import PROFILE, line_of

from rig.cli.app import run_command
from rig.devices.protocols import Codes, Shown
from rig.devices.simulated.devices import SimulatedCamera, SimulatedProjector
from rig.devices.simulated.pair import SimulatedPair

Float32Array = NDArray[np.float32]
Levels = NDArray[np.uint16]
OfCodes = Callable[[Codes], Codes]
OfLight = Callable[[Float32Array], Float32Array]
OfLevels = Callable[[Levels, int, float], Levels]
"""Of a camera's levels, the frame's number and full scale."""
EVENTS = (28, 54, 84, 114, 135)
"""Frames before something happens: on ci-tiny among sweeps, levels and stripes, before and among the checks."""


def _sharpened(picture: Float32Array, amount: float, radius_px: float) -> Float32Array:
    soft = cv2.GaussianBlur(picture, (0, 0), radius_px).reshape(picture.shape)
    return np.asarray(picture + amount * (picture - soft))


def _to_codes(picture: Float32Array) -> Codes:
    return np.asarray(np.clip(np.rint(picture), 0, 255), dtype=np.uint8)


def _zoomed(picture: NDArray[Any], scale: float, border: int = cv2.BORDER_CONSTANT) -> NDArray[Any]:
    height, width = picture.shape[:2]
    matrix = cv2.getRotationMatrix2D(((width - 1) / 2, (height - 1) / 2), 0.0, scale)
    return np.asarray(cv2.warpAffine(picture, matrix, (width, height), flags=cv2.INTER_LINEAR, borderMode=border))


def _keystone(codes: Codes, share: float) -> Codes:
    height, width = codes.shape[:2]
    corners = np.array([[0, 0], [width - 1, 0], [width - 1, height - 1], [0, height - 1]], dtype=np.float32)
    inset = np.float32(share * width)
    moved = corners + np.array([[inset, 0], [-inset, 0], [0, 0], [0, 0]], dtype=np.float32)
    return np.asarray(cv2.warpPerspective(codes, cv2.getPerspectiveTransform(corners, moved), (width, height)))


class _Lag:
    """A slow panel: some of the picture before is still there."""

    def __init__(self, share: float) -> None:
        self.share, self.before = share, np.zeros(0, dtype=np.float32)

    def __call__(self, codes: Codes) -> Codes:
        now = codes.astype(np.float32)
        before = self.before if self.before.shape == now.shape else now
        self.before = now
        return _to_codes((1 - self.share) * now + self.share * before)


def _iris(linear: Float32Array) -> Float32Array:
    """Closes in dark pictures."""
    return np.asarray(linear * np.float32(0.7 + 0.3 * min(1.0, float(linear.mean()) / 0.3)))


def _power_limit(linear: Float32Array) -> Float32Array:
    """White costs power: bright pictures are dimmed."""
    return np.asarray(linear * np.float32(1 - 0.15 * float(linear.mean())))


def _stray(share: float, light: Float32Array) -> Float32Array:
    """Light that a lens spreads over the whole picture."""
    return np.asarray((1 - share) * light + np.float32(share * float(light.mean())))


def _halo(share: float, light: Float32Array) -> Float32Array:
    """Light that a dusty lens spreads about itself, over an eighth of the picture."""
    soft = cv2.GaussianBlur(light, (0, 0), light.shape[1] / 16)
    return np.asarray((1 - share) * light + np.float32(share) * soft)


def _speck(light: Float32Array) -> Float32Array:
    """Dust near the picture's middle takes a fifth of the light."""
    y, x = np.indices(light.shape[:2]).astype(np.float64)
    far: NDArray[np.float64] = (x - 0.55 * light.shape[1]) ** 2 + (y - 0.45 * light.shape[0]) ** 2
    return np.asarray(light * (1 - 0.2 * np.exp(-far / (2 * (0.05 * light.shape[1]) ** 2))), dtype=np.float32)


def _autofocus(picture: Float32Array, frame: int) -> Float32Array:
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), 0.4 + 0.8 * abs(np.sin(frame / 13))))


def _breathing(picture: Float32Array, frame: int) -> Float32Array:
    """A lens whose focus moves changes its focal length, too."""
    return _zoomed(picture, 1 + 0.004 * float(np.sin(frame / 17)), cv2.BORDER_REPLICATE)


class _FrameAverage:
    """A camera that takes noise away by means over time."""

    def __init__(self, share: float) -> None:
        self.share, self.before = share, np.zeros(0, dtype=np.float32)

    def __call__(self, picture: Float32Array, _: int) -> Float32Array:
        before = self.before if self.before.shape == picture.shape else picture
        self.before = np.asarray((1 - self.share) * picture + self.share * before)
        return self.before


def _stabiliser(picture: Float32Array, frame: int) -> Float32Array:
    return _moved(float(np.random.default_rng(frame).normal(0, 0.5)), picture)


def _denoised(picture: Float32Array, _: int) -> Float32Array:
    return np.asarray(cv2.bilateralFilter(np.ascontiguousarray(picture[..., 0]), 5, 0.03, 1.5))


def _dead_rows(picture: Float32Array, _: int) -> Float32Array:
    dead = picture.copy()
    dead[100:104] = 0
    return dead


def _mirror(light: Float32Array) -> Float32Array:
    """A glass door that is dark behind, where another part of the room is seen."""
    height, width = light.shape[:2]
    rows, left, right = slice(height * 5 // 12, height * 10 // 12), width * 9 // 16, width * 14 // 16
    seen = light.copy()
    seen[rows, left:right] = (
        np.float32(0.85) * light[rows, width - right - width // 16 : width - left - width // 16][:, ::-1]
    )
    return seen


def _of_float(change: Callable[[Float32Array, int], Float32Array]) -> OfLevels:
    """A change of levels as shares of full scale."""

    def changed(levels: Levels, frame: int, full: float) -> Levels:
        picture = change(levels.astype(np.float32) / np.float32(full), frame)
        return np.asarray(np.clip(np.rint(picture.reshape(levels.shape) * full), 0, full), dtype=np.uint16)

    return changed


def _median(picture: Float32Array, _: int) -> Float32Array:
    return np.asarray(cv2.medianBlur(picture, 3))


def _local_tone(picture: Float32Array, _: int) -> Float32Array:
    """Shadows are lifted where their neighbourhood is dark."""
    around = cv2.GaussianBlur(picture, (0, 0), picture.shape[1] / 20).reshape(picture.shape)
    return np.asarray(picture * (1 + 0.4 * np.clip(0.3 - around, 0, None)))


def _automatic_gain(picture: Float32Array, _: int) -> Float32Array:
    return np.asarray(picture * np.float32(1 + 0.3 * (0.2 - float(picture.mean()))))


def _moved(by_px: float, picture: Float32Array) -> Float32Array:
    matrix = np.array([[1, 0, by_px], [0, 1, 0.4 * by_px]], dtype=np.float64)
    height, width = picture.shape[:2]
    return np.asarray(cv2.warpAffine(picture, matrix, (width, height), borderMode=cv2.BORDER_REPLICATE))


def _passer_by(picture: Float32Array, frame: int, first: int, frames: int) -> Float32Array:
    """Somebody walks through the picture, for so many frames."""
    if not first <= frame < first + frames:
        return picture
    left = int((0.1 + 0.8 * (frame - first) / frames) * picture.shape[1])
    dark = picture.copy()
    dark[picture.shape[0] // 4 :, left : left + picture.shape[1] // 8] *= np.float32(0.3)
    return dark


def _hot(picture: Float32Array, _: int) -> Float32Array:
    random = np.random.default_rng(7)
    hot = picture.copy()
    hot[random.uniform(size=picture.shape) < 2e-3] = 1.0
    return hot


def _columns(picture: Float32Array, _: int) -> Float32Array:
    offsets = np.random.default_rng(8).normal(0, 0.004, (1, picture.shape[1], 1)).astype(np.float32)
    return np.asarray(picture + offsets)


def _upscaled(picture: Float32Array, _: int) -> Float32Array:
    height, width = picture.shape[:2]
    half = cv2.resize(picture, (width // 2, height // 2), interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.resize(half, (width, height), interpolation=cv2.INTER_LINEAR))


def _after(picture: Float32Array, frame: int, change: OfLight, first: int) -> Float32Array:
    return picture if frame < first else change(picture)


def _brighter(picture: Float32Array) -> Float32Array:
    return np.asarray(picture + np.float32(0.05))


PROJECTORS: dict[str, OfCodes] = {
    "sharpness of the picture mode": lambda codes: _to_codes(_sharpened(codes.astype(np.float32), 0.6, 1.5)),
    "limited range": lambda codes: _to_codes((codes.astype(np.float32) - 16) * 255 / 219),
    "lifted range": lambda codes: _to_codes(16 + codes.astype(np.float32) * 219 / 255),
    "six bits": lambda codes: np.asarray(codes & 0xFC),
    "overscan of 3 %": partial(_zoomed, scale=1.03),
    "underscan of 3 %": partial(_zoomed, scale=0.97),
    "keystone": partial(_keystone, share=0.03),
    "slow panel": _Lag(0.04),
    "mirrored for rear projection": lambda codes: np.ascontiguousarray(codes[:, ::-1]),
    "upside down": lambda codes: np.ascontiguousarray(codes[::-1, ::-1]),
}
LAMPS: dict[str, OfLight] = {
    "dynamic iris": _iris,
    "power limit": _power_limit,
    "stray light of 1 % in the projector": partial(_stray, 0.01),
    "halo of 5 % in the projector": partial(_halo, 0.05),
    "dust on the projector": _speck,
}
LENSES: dict[str, OfLight] = {
    "stray light of 1 % in the camera": partial(_stray, 0.01),
    "stray light of 4 % in the camera": partial(_stray, 0.04),
    "halo of 5 % in the camera": partial(_halo, 0.05),
    "dust on the camera": _speck,
    "mirror on a wall": _mirror,
}
CAMERAS: dict[str, OfLevels] = {
    "camera's sharpness": _of_float(lambda picture, _: _sharpened(picture, 0.6, 1.2)),
    "median of the camera": _of_float(_median),
    "local tone": _of_float(_local_tone),
    "automatic gain": _of_float(_automatic_gain),
    "camera creeps": _of_float(lambda picture, frame: _moved(0.01 * frame, picture)),
    "daylight grows": _of_float(lambda picture, frame: np.asarray(picture + np.float32(3e-4 * frame))),
    "autofocus hunts": _of_float(_autofocus),
    "lens breathes": _of_float(_breathing),
    "means over time": _of_float(_FrameAverage(0.2)),
    "stabiliser": _of_float(_stabiliser),
    "noise smoothed away": _of_float(_denoised),
    "gain creeps": _of_float(lambda picture, frame: picture * np.float32(1 + 8e-4 * frame)),
    "dead rows": _of_float(_dead_rows),
    "hot pixels": _of_float(_hot),
    "columns differ": _of_float(_columns),
    "picture scaled up": _of_float(_upscaled),
    "mirrored camera": _of_float(lambda picture, _: picture[:, ::-1]),
}
CAMERAS |= {
    f"{name} at frame {first}": _of_float(change)
    for first in EVENTS
    for name, change in (
        ("camera moved by 2 px", partial(_after, change=partial(_moved, 2.0), first=first)),
        ("camera moved by 0.3 px", partial(_after, change=partial(_moved, 0.3), first=first)),
        ("lights switched on", partial(_after, change=_brighter, first=first)),
        ("passer-by", partial(_passer_by, first=first, frames=8)),
        ("somebody who lingers", partial(_passer_by, first=first, frames=24)),
    )
}
NAMES = ("nothing", *PROJECTORS, *LAMPS, *LENSES, *CAMERAS)


@contextmanager
def meddling(name: str) -> Iterator[None]:
    """Let the simulated devices do so to every picture."""
    show, linear_of = SimulatedProjector.show, SimulatedPair.projector_linear
    through_lens, expose = SimulatedPair.through_lens, vars(SimulatedCamera)["_expose"]
    frames = iter(range(10**9))

    def shown(self: SimulatedProjector, codes: Codes, *, name: str) -> Shown:
        return show(self, of_codes(codes), name=name)

    def exposed(self: SimulatedCamera, start_s: float, exposure_s: float) -> Levels:
        return of_levels(expose(self, start_s, exposure_s), next(frames), self.full_scale_dn)

    with contextlib.ExitStack() as stack:
        if of_codes := PROJECTORS.get(name):
            stack.enter_context(mock.patch.object(SimulatedProjector, "show", shown))
        if of_lamp := LAMPS.get(name):
            stack.enter_context(
                mock.patch.object(
                    SimulatedPair, "projector_linear", lambda self, codes: of_lamp(linear_of(self, codes))
                )
            )
        if of_lens := LENSES.get(name):
            stack.enter_context(
                mock.patch.object(SimulatedPair, "through_lens", lambda self, light: of_lens(through_lens(self, light)))
            )
        if of_levels := CAMERAS.get(name):
            stack.enter_context(mock.patch.object(SimulatedCamera, "_expose", exposed))
        yield


def outcome(name: str, profile: Path, keep: Path | None) -> str:
    """Run one session; what became of it."""
    with tempfile.TemporaryDirectory() as scratch:
        session = (keep or Path(scratch)) / name.replace(" ", "-")
        out, err = io.StringIO(), io.StringIO()
        with meddling(name), contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            command = ["run", str(session), "-p", str(profile), "--strategies", "none,bounded", "--json"]
            status = run_command(command)
    if not out.getvalue().strip():
        said = [line[5:] for line in err.getvalue().splitlines() if line.startswith("rig: ")]
        return f"{name} | refused ({status}): {' '.join(said) or err.getvalue()[-800:]}"
    answer: dict[str, Any] = json.loads(out.getvalue())
    return f"{name} | {line_of(answer)}"


def main() -> int:
    """Run sessions with meddling devices, a line each."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--profile", type=Path, default=PROFILE)
    parser.add_argument("--only", nargs="*", default=[], help="words of the names; default: all")
    parser.add_argument("--keep", type=Path, help="keep the sessions there")
    parser.add_argument("--jobs", type=int, default=2)
    wanted = parser.parse_args()
    chosen = [name for name in NAMES if not wanted.only or any(word in name for word in wanted.only)]
    with ProcessPoolExecutor(wanted.jobs) as pool:
        for line in pool.map(partial(outcome, profile=wanted.profile, keep=wanted.keep), chosen):
            print(line, flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
