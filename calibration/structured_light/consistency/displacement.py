"""By how much one photograph of a scene is displaced against another, to thousandths of a pixel."""

from __future__ import annotations

import cv2
import numpy as np

from calibration.arrays import BoolArray, FloatArray

_ROUNDS = 2
"""Of whole pixels and rest: the first rest may be more than half a pixel where noise is strong."""
_SMOOTH_PX = 1.5
"""So that a derivative from four neighbours is that of the picture, and a mosaic's pattern is gone."""
_INSIDE = 0.05
"""Of the window: pixels nearer to the border are left out, where whole-pixel shifts wrap."""
_LAID = 0.8
"""Of the squared difference that a true shift leaves over at most; of noise alone any leaves 1."""
_LARGE_PX = 500_000
"""Larger images are halved first: seconds saved, and still thousandths of a pixel."""


def shift_px(image: FloatArray, reference: FloatArray) -> tuple[float, float]:
    """Find by how much an image is displaced against another, whatever their brightness.

    Phase correlation finds it roughly, the image is put back by whole pixels, and what is left follows from the
    gradient. No interpolation: OpenCV's moves edges by hundredths of a pixel.

    Parameters
    ----------
    image, reference : (H, W)
        Photographs of one scene.

    Returns
    -------
    (x, y)
        To the right and down. [px]
    """
    if image.size > _LARGE_PX:
        half_x, half_y = shift_px(_halved(image), _halved(reference))
        return 2 * half_x, 2 * half_y
    window = _window(image)
    # copies: OpenCV 5 multiplies what it is given by the window
    (x, y), _ = cv2.phaseCorrelate(reference.copy(), image.copy(), window.copy())
    found = np.array([x, y])
    for _ in range(_ROUNDS):
        whole = np.rint(found).astype(int)
        back = np.roll(image, (-whole[1], -whole[0]), axis=(0, 1))
        found = whole + _small_shift(back, reference, window)
    return float(found[0]), float(found[1])


def _window(image: FloatArray) -> FloatArray:
    """(H, W) weights that fall to 0 at the border."""
    return np.asarray(cv2.createHanningWindow((image.shape[1], image.shape[0]), cv2.CV_64F), dtype=np.float64)


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


def clear_shift_px(image: FloatArray, reference: FloatArray, most: float = np.inf) -> tuple[float, float]:
    """Find a displacement that can be seen: of a bare wall there is none.

    Parameters
    ----------
    image, reference : (H, W)
        Photographs of one scene.
    most : float
        From here on both are taken as clipped.

    Returns
    -------
    (x, y)
        As :func:`shift_px`; 0 where that would not lay the photographs over each other. [px]
    """
    image, reference = np.minimum(image, most), np.minimum(reference, most)
    if min(float(np.ptp(image)), float(np.ptp(reference))) == 0:
        return 0.0, 0.0
    x, y = shift_px(image, reference)
    window = _window(image)
    inside = window > _INSIDE
    there, here = (_of_unit_contrast(one, inside) for one in (image, reference))
    back = np.array([[1, 0, x], [0, 1, y]], dtype=np.float64)
    size, how = (image.shape[1], image.shape[0]), cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    laid = cv2.warpAffine(there, back, size, flags=how, borderMode=cv2.BORDER_REPLICATE)
    before, after = (float((window * (one - here) ** 2).sum()) for one in (there, laid))
    return (x, y) if after < _LAID * before else (0.0, 0.0)
