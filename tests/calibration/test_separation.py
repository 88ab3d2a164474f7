"""Separation of a synthetic scene whose direct and global light are known pixel by pixel."""

from dataclasses import dataclass

import cv2
import numpy as np
import pytest

from calibration.errors import CalibrationError
from calibration.light.separation import separate, separate_by_pattern
from calibration.structured_light.correspondence import Correspondence, PixelReason
from calibration.structured_light.patterns import checker_patterns

PROJECTOR = (128, 160)
CAMERA = (140, 180)


@dataclass(frozen=True, kw_only=True)
class Scene:
    """A wall that the projector lights directly, and light that comes back from everywhere."""

    direct: np.ndarray
    global_: np.ndarray
    xy: np.ndarray
    """(H, W, 2) projector coordinates of the camera's pixels."""
    defocus_px: float
    noise: float
    leak: float
    """Share of full light that unlit checks get."""

    @property
    def white(self) -> np.ndarray:
        return self.direct + self.global_

    def photograph(self, codes: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        light = self.leak + (1 - self.leak) * codes.astype(np.float64) / 255
        sharp = cv2.GaussianBlur(light, (0, 0), self.defocus_px, borderType=cv2.BORDER_REPLICATE)
        # Light that went to and fro no longer knows the checks, but still how much of the picture is lit.
        spread = cv2.blur(light, (96, 96), borderType=cv2.BORDER_REFLECT)
        seen = [
            cv2.remap(x, *np.moveaxis(self.xy, -1, 0), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            for x in (sharp, spread)
        ]
        image = self.direct * seen[0] + self.global_ * seen[1]
        shot = np.sqrt(np.maximum(image, 0) + 0.01) * self.noise
        return (image + shot * rng.normal(size=image.shape)).astype(np.float32)

    def checkers(self) -> list[np.ndarray]:
        rng = np.random.default_rng(11)
        return [self.photograph(pattern.codes, rng) for pattern in checker_patterns(PROJECTOR)]

    def correspondence(self) -> Correspondence:
        """As decoded and refined: a twentieth of a pixel off."""
        error = np.random.default_rng(12).normal(0, 0.05, self.xy.shape)
        reason = np.zeros(CAMERA, dtype=np.uint8)
        return Correspondence((self.xy + error).astype(np.float32), reason, PROJECTOR)


def scene(defocus_px: float = 0.6, noise: float = 0.01, leak: float = 0.0) -> Scene:
    y, x = np.mgrid[: CAMERA[0], : CAMERA[1]].astype(np.float64)
    xy = np.stack([10 + 0.78 * x + 0.02 * y, 8 + 0.77 * y - 0.01 * x], axis=-1).astype(np.float32)
    direct = 0.5 + 0.15 * np.sin(x / 40) + 0.1 * np.cos(y / 25)
    global_ = 0.3 + 0.1 * np.sin(x / 90 + y / 70)
    return Scene(direct=direct, global_=global_, xy=xy, defocus_px=defocus_px, noise=noise, leak=leak)


def bias(found: np.ndarray, true: np.ndarray, valid: np.ndarray) -> float:
    return float(np.mean(found[valid] - true[valid]) / np.mean(true[valid]))


def patterns() -> list[np.ndarray]:
    return [pattern.codes for pattern in checker_patterns(PROJECTOR)]


@pytest.mark.parametrize(("defocus_px", "noise"), [(0.3, 0.002), (0.6, 0.02), (1.2, 0.01), (1.8, 0.002)])
def test_with_a_correspondence_both_parts_are_right_to_half_a_percent_however_blurred(
    defocus_px: float, noise: float
) -> None:
    """At 1.8 px the blur reaches the middle of every check: means over lit and unlit checks would lose a tenth."""
    true = scene(defocus_px, noise)
    found = separate_by_pattern(true.checkers(), patterns(), true.correspondence(), white=true.white.astype(np.float32))
    assert found.valid.mean() > 0.95
    assert abs(bias(found.direct, true.direct, found.valid)) < 0.005
    assert abs(bias(found.global_, true.global_, found.valid)) < 0.008
    assert np.allclose((found.direct + found.global_)[found.valid], true.white[found.valid], atol=1e-5)


def test_each_pixel_is_right_within_its_noise() -> None:
    true = scene(noise=0.01)
    found = separate_by_pattern(true.checkers(), patterns(), true.correspondence(), white=true.white.astype(np.float32))
    error = (found.direct - true.direct)[found.valid] / true.direct[found.valid]
    assert np.std(error) < 0.02


def test_the_stated_variance_of_direct_light_is_that_of_its_errors() -> None:
    true = scene(noise=0.02)
    found = separate_by_pattern(true.checkers(), patterns(), true.correspondence(), white=true.white.astype(np.float32))
    assert found.variance is not None
    inner = found.valid & (np.hypot(*np.gradient(true.direct)) < 0.02)
    errors = (found.direct - true.direct)[inner] / np.sqrt(found.variance[inner])
    assert 0.7 < np.std(errors) < 1.4


def test_a_place_that_the_code_has_a_third_of_a_pixel_off_is_mended_by_the_checks_edges() -> None:
    true = scene(noise=0.005)
    off = true.correspondence()
    off.projector_xy_px[..., 0] += 0.3
    found = separate_by_pattern(true.checkers(), patterns(), off, white=true.white.astype(np.float32))
    assert found.projector_xy_px is not None
    error = (found.projector_xy_px - true.xy)[20:-20, 20:-20]
    assert np.median(np.abs(error)) < 0.3 / 8
    assert abs(bias(found.direct, true.direct, found.valid)) < 0.005


def test_pixels_without_a_projector_pixel_are_not_valid() -> None:
    true = scene()
    map_ = true.correspondence()
    map_.projector_xy_px[50:60, 70:80] = np.nan
    map_.reason[50:60, 70:80] = PixelReason.DARK
    found = separate_by_pattern(true.checkers(), patterns(), map_, white=true.white.astype(np.float32))
    assert not found.valid[50:60, 70:80].any()
    assert found.valid[100:200, 100:200].all()


def test_where_nothing_corresponds_nothing_is_separated() -> None:
    true = scene()
    xy = np.full((*CAMERA, 2), np.nan, dtype=np.float32)
    dark = Correspondence(xy, np.full(CAMERA, PixelReason.DARK, dtype=np.uint8), PROJECTOR)
    with pytest.raises(CalibrationError, match="0 lit pixels with a projector pixel"):
        separate_by_pattern(true.checkers(), patterns(), dark, white=true.white.astype(np.float32))


@pytest.mark.parametrize("leak", [0.0, 0.05, 0.2])
def test_without_a_correspondence_the_parts_follow_the_formulae_of_nayar(leak: float) -> None:
    """No blur and no noise: L+ and L- are exact, and so has to be the result."""
    rng = np.random.default_rng(13)
    direct, global_ = rng.uniform(0.2, 0.8, (2, *CAMERA))
    lit = (0.5 * (1 - leak) + leak) * global_
    frames = [direct + lit, leak * direct + lit] * 6
    found = separate(frames, leak=leak)  # type: ignore[arg-type]
    assert found.direct == pytest.approx(direct, abs=1e-5)
    assert found.global_ == pytest.approx(global_, abs=1e-5)
    assert found.valid.all()


@pytest.mark.parametrize("noise", [0.002, 0.01])
def test_without_a_correspondence_the_bias_stays_within_three_percent(noise: float) -> None:
    true = scene(0.4, noise)
    found = separate(true.checkers(), white=true.white.astype(np.float32))
    assert abs(bias(found.direct, true.direct, found.valid)) < 0.03
    assert np.allclose(found.direct + found.global_, true.white, rtol=1e-4)


def test_frames_may_come_one_at_a_time() -> None:
    true = scene()
    at_once = separate(true.checkers())
    one_by_one = separate(frame for frame in true.checkers())
    assert np.array_equal(at_once.direct, one_by_one.direct)


def test_too_few_frames_are_refused() -> None:
    with pytest.raises(CalibrationError, match="5 checker frames, at least 6"):
        separate([np.ones((4, 4), dtype=np.float32)] * 5)


@pytest.mark.parametrize("leak", [-0.1, 0.5, 0.9])
def test_a_leak_that_separates_nothing_is_refused(leak: float) -> None:
    with pytest.raises(CalibrationError, match="leak"):
        separate([np.ones((4, 4), dtype=np.float32)] * 6, leak=leak)


def test_the_stated_variance_of_places_is_that_of_their_errors() -> None:
    true = scene(noise=0.02)
    found = separate_by_pattern(true.checkers(), patterns(), true.correspondence(), white=true.white.astype(np.float32))
    assert found.projector_xy_px is not None
    assert found.place_variance_px2 is not None
    inner = slice(20, -20), slice(20, -20)
    errors = (found.projector_xy_px - true.xy)[inner] / np.sqrt(found.place_variance_px2[inner])[..., None]
    assert 0.7 < 1.4826 * np.median(np.abs(errors)) < 1.4


def test_a_place_far_from_every_edge_of_the_checks_is_said_to_be_unknown() -> None:
    true = scene(defocus_px=0.3)
    large = [pattern.codes for pattern in checker_patterns(PROJECTOR, size_px=32, shifts=9)]
    rng = np.random.default_rng(13)
    frames = [true.photograph(codes, rng) for codes in large]
    found = separate_by_pattern(frames, large, true.correspondence(), white=true.white.astype(np.float32))
    assert found.projector_xy_px is not None
    assert found.place_variance_px2 is not None
    to_edge = np.empty_like(true.xy)
    for axis in (0, 1):
        changes = np.any([np.diff(codes.astype(int), axis=1 - axis).any(axis=axis) for codes in large], axis=0)
        edges_px = np.flatnonzero(changes) + 0.5
        to_edge[..., axis] = np.abs(true.xy[..., axis, None] - edges_px).min(axis=-1)
    far, near = to_edge.max(axis=-1) > 4, to_edge.max(axis=-1) < 0.5
    assert np.isfinite(found.place_variance_px2).all()
    assert found.place_variance_px2[far].min() > 100 * np.median(found.place_variance_px2[near])
