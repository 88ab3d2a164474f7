"""Whether things stay where they are: the picture's shift between frames, and the light of white through the check."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from rig.devices.protocols import Codes
from rig.self_check.rig_under_test import BoolArray, FloatArray, RigUnderTest, line_through
from rig.self_check.rows import Measured, Row

_FRAMES = 24
_BLOCKS = 40
"""Along the longer side of the picture: large enough to be sharp, small enough to hold still by."""
_SEED = 7
_REFERENCE_FRAMES = 3
_ROUNDS = 2
_SMOOTH_PX = 1.5
_INSIDE = 0.05
"""Of the window: pixels nearer to the border are left out, where whole-pixel shifts wrap."""
_LARGE_PX = 500_000
"""Larger images are halved first: seconds saved, and still thousandths of a pixel."""


@dataclass(frozen=True, slots=True)
class Landmark:
    """The scene under a picture full of edges, at the beginning of the check."""

    codes: Codes
    image: FloatArray
    """(H, W) digital numbers, noise averaged down."""


def blocks(shape: tuple[int, int]) -> Codes:
    """Random light and dark blocks, always the same."""
    size = max(max(shape) // _BLOCKS, 1)
    small = np.random.default_rng(_SEED).integers(0, 2, (shape[0] // size + 1, shape[1] // size + 1)) * 215 + 40
    whole = np.repeat(np.repeat(small, size, axis=0), size, axis=1)
    return np.asarray(whole[: shape[0], : shape[1]], dtype=np.uint8)


def note_landmark(subject: RigUnderTest) -> Landmark:
    """Photograph the blocks."""
    codes = blocks(subject.rig.projector.shape)
    frames = [subject.photograph(codes, "blocks") for _ in range(_REFERENCE_FRAMES)]
    return Landmark(codes, np.asarray(np.mean(frames, axis=0)))


def shift_px(image: FloatArray, reference: FloatArray) -> tuple[float, float]:
    """(x, y) by which an image is displaced against another.

    Phase correlation finds it roughly, the image is put back by whole pixels, and what is left follows from the
    gradient. No interpolation: OpenCV's moves edges by hundredths of a pixel.
    """
    if image.size > _LARGE_PX:
        half_x, half_y = shift_px(_halved(image), _halved(reference))
        return 2 * half_x, 2 * half_y
    window = np.asarray(cv2.createHanningWindow((image.shape[1], image.shape[0]), cv2.CV_64F), dtype=np.float64)
    # copies: OpenCV 5 multiplies what it is given by the window
    (x, y), _ = cv2.phaseCorrelate(reference.copy(), image.copy(), window.copy())
    found = np.array([x, y])
    for _ in range(_ROUNDS):
        whole = np.rint(found).astype(int)
        back = np.roll(image, (-whole[1], -whole[0]), axis=(0, 1))
        found = whole + _small_shift(back, reference, window)
    return float(found[0]), float(found[1])


def _halved(image: FloatArray) -> FloatArray:
    return np.asarray(cv2.pyrDown(image), dtype=np.float64)


def _small_shift(image: FloatArray, reference: FloatArray, window: FloatArray) -> FloatArray:
    """Least squares of image - reference = -gradient · shift, brightness free; good to half a pixel."""
    inside = window > _INSIDE
    first, second = (_of_unit_contrast(one, inside) for one in (image, reference))
    middle = (first + second) / 2
    terms = np.stack([-_slope(middle, 1)[inside], -_slope(middle, 0)[inside]], axis=-1)
    return np.asarray(np.linalg.solve(terms.T @ terms, terms.T @ (first - second)[inside]))


def _of_unit_contrast(image: FloatArray, inside: BoolArray) -> FloatArray:
    """Smooth, and of the same brightness and contrast whatever the lamp does."""
    smooth = np.asarray(cv2.GaussianBlur(image, (0, 0), _SMOOTH_PX))
    return np.asarray((smooth - smooth[inside].mean()) / smooth[inside].std())


def _slope(image: FloatArray, axis: int) -> FloatArray:
    """Derivative along an axis, from four neighbours."""
    near = np.roll(image, -1, axis) - np.roll(image, 1, axis)
    far = np.roll(image, -2, axis) - np.roll(image, 2, axis)
    return np.asarray((8 * near - far) / 12)


def check_stability(subject: RigUnderTest, reference_image: Landmark) -> Measured:
    """Vibration within a series, shift and light since the beginning."""
    frames = subject.series(reference_image.codes, _FRAMES, "blocks")
    shifts = np.array([shift_px(subject.pixels(frame), reference_image.image) for frame in frames])
    vibration = float(np.sqrt(shifts.var(axis=0).sum()))
    moved = float(np.hypot(*shifts.mean(axis=0)))
    subject.note_reference()
    change, per_minute = _drift(subject)
    limits = subject.limits
    rows = (
        Row("vibration of the picture, rms", vibration, "px", limits.vibration_px,
            advice="screw camera and projector to something heavy; no fan and no footstep near them"),
        Row("shift of the picture since the beginning", moved, "px", limits.shift_px,
            advice="let the mounts settle and the lenses warm up; image stabiliser and autofocus off"),
        Row("change of white between first and last frame", change, "%", limits.drift_percent,
            advice="let the lamp warm up for half an hour; dynamic iris, eco mode and automatic gain off"),
        Row("drift of white", per_minute, "% a minute", limits.drift_percent_per_minute,
            advice="as above; daylight in the room drifts, too"),
    )  # fmt: skip
    numbers = {
        "shifts_px": [[float(x), float(y)] for x, y in shifts],
        "white_times_s": [t for t, _ in subject.references],
        "white_light_dn": [light for _, light in subject.references],
    }
    return Measured(rows, {}, numbers)


def _drift(subject: RigUnderTest) -> tuple[float, float]:
    """Change from first to last reference, and slope over all if it is more than scatter. [%, % a minute]."""
    times_s, light = (np.array(values) for values in zip(*subject.references, strict=True))
    change = 100 * abs(float(light[-1] / light[0]) - 1)
    slope, intercept = line_through(times_s - times_s[0], light)
    scatter = light - intercept - slope * (times_s - times_s[0])
    sigma = float(np.sqrt((scatter**2).sum() / max(len(light) - 2, 1) / ((times_s - times_s.mean()) ** 2).sum()))
    sure = max(abs(slope) - 2 * sigma, 0.0)
    return change, 60 * 100 * sure / float(light.mean())
