"""Direct and global light by shifted checkers (Nayar et al. 2006): step `separation`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from calibration.arrays import Codes
from calibration.light.blur import LensBlur, PointSpread, fit_point_spread, footprint_map, variance_sigma_map
from calibration.light.check_size import (
    blur_of_picture_px,
    check_size_px,
    pixel_of_picture_px,
    stripes_that_tell,
    why_checks_are_larger,
)
from calibration.light.cross_check import CrossCheck, cross_check
from calibration.light.processing import scatter_in_middles
from calibration.light.separation import Separation, separate, separate_by_pattern, with_more_direct
from calibration.light.two_level import Footprint, white_share
from calibration.radiometry.mosaic import Mosaic
from calibration.structured_light.correspondence import Correspondence
from calibration.structured_light.patterns import checker_patterns, flat
from rig.capture.rig import Rig
from rig.files.channels import layers
from rig.plug_ins import find_code
from rig.profile.schema import Profile
from rig.records import JsonObject, json_of
from rig.session import Session, Step
from rig.stages.correspondence import load_correspondence
from rig.stages.light.lamp import LampRecord, lamp_since, take_before_white, time_of, without_drift
from rig.stages.light.odd_checks import are_few, first_names, odd_among, refuse_odd
from rig.stages.light.records import BlurRecord, SeparationRecord
from rig.stages.light.repeats import WHITES, white_bracket
from rig.stages.linear_light import (
    BoolArray,
    Float32Array,
    FloatArray,
    LightImage,
    RadiometricCalibration,
    merge_raw_exposures,
)
from rig.stages.photograph import ExposureBracket, frame_name, photograph
from rig.stages.radiometry import averaged_settings, load_radiometric_calibration, measuring_bracket
from rig.terminal import OnStep

_OF_CHECKS = 0.5
"""Of what processing adds to pictures of checks, in pictures that people show."""
_LIT_SHARE = 0.2
"""Of the median direct light: pixels above it tell how well the two ways to separate agree."""


def separation_settings(session: Session) -> JsonObject:
    """Return what step `separation` depends on."""
    patterns = session.profile.patterns
    return {
        "exposures_s": json_of(measuring_bracket(session).exposures_s),
        **averaged_settings(measuring_bracket(session)),
        **_whites_settings(white_bracket(session)),
        "by": "weighted regression on the blurred pattern, places too, with variances; by middles; at the border, too",
        "edges": "of things: as blurred as on either side",
        "lamp": "taken out",
        "checker": [
            patterns.checker_size_px,
            patterns.checker_shifts,
            "larger where stripes are blurred, with middles",
        ],
    }


def _whites_settings(bracket: ExposureBracket) -> JsonObject:
    """How often white is photographed; nothing where it is as often as ever."""
    return {} if bracket.repeats == WHITES else {"whites": bracket.repeats}


def separation_frames(profile: Profile) -> int:
    """Return how many frames step `separation` takes."""
    return (WHITES + profile.patterns.checker_shifts + 1) * len(profile.patterns.exposures)


def extra_frames(session: Session, _: int) -> int:
    """Return how many more noise and room light ask for than a profile says."""
    checks = (session.profile.patterns.checker_shifts + 1) * measuring_bracket(session, repeats=1).frames_per_pattern
    return white_bracket(session).frames_per_pattern + checks - separation_frames(session.profile)


def separate_light(rig: Rig, session: Session, step: Step, on_step: OnStep) -> None:
    """Step `separation`: photograph white and the checkers, and split white into direct and global light."""
    shape, blur_px = rig.projector.shape, _blur_of_stripes(session)
    pixel_px = pixel_of_picture_px(load_correspondence(session))
    size_px = check_size_px(rig.profile.patterns.checker_size_px, blur_px or 0.0, shape, camera_pixel_px=pixel_px)
    _say(size_px, rig.profile, on_step, why_checks_are_larger(blur_px, pixel_px))
    bracket = measuring_bracket(session, repeats=1)
    of_white = white_bracket(session)
    checkers = list(checker_patterns(shape, size_px, rig.profile.patterns.checker_shifts))
    take = partial(photograph, rig, session, step, on_step=on_step)
    take([flat(shape, 255, "white")], bracket=of_white, n_patterns=1)
    take_before_white(partial(take, bracket=bracket, n_patterns=len(checkers) + 1), checkers, shape, on_step)
    radiometric = load_radiometric_calibration(session)
    white = merge_raw_exposures(step, "white", of_white, radiometric)
    lamp = lamp_since(step, bracket, radiometric, (white, time_of(step, "white", of_white)))
    step.save_record("whites-of-separation", lamp)
    names, codes = [pattern.name for pattern in checkers], [pattern.codes for pattern in checkers]
    frames = [_checker(step, name, bracket, radiometric, lamp=lamp) for name in _told(names, on_step)]
    checks, correspondence = _Checks(names, codes, frames), load_correspondence(session)
    found, left_out = _without_odd(checks, white, correspondence, on_step)
    _save(step, white, found.bright, found.known, mosaic=radiometric.mosaic)
    step.save_image("blur", _blur_maps(found, mosaic=radiometric.mosaic), folder="maps")
    processing_dn = _processing_noise_dn(checks, found, (white, of_white), radiometric)
    record = _record(found, checks=(size_px, blur_px, pixel_px), left_out=left_out)
    step.save_record("separation", replace(record, processing_noise_dn=processing_dn))


@dataclass(frozen=True, eq=False)
class _Checks:
    """Photographs of checks, by name: the codes that were shown, and (H, W, B) the light of each."""

    names: Sequence[str]
    codes: Sequence[Codes]
    frames: Sequence[Float32Array]

    def without(self, odd: BoolArray) -> _Checks:
        """The others."""
        kept = np.flatnonzero(~odd).tolist()
        return _Checks([self.names[k] for k in kept], [self.codes[k] for k in kept], [self.frames[k] for k in kept])


@dataclass(frozen=True, eq=False, kw_only=True)
class _Separated:
    """White split into direct and global light, and how well the pictures agree about it."""

    spread: PointSpread
    bright: Separation
    """By the brightest and darkest frames ..."""
    known: Separation
    """... and by the known pattern; (H, W, B) each."""
    finer: Correspondence
    """With the places that the checks' edges tell."""
    seen: Footprint
    crossed: CrossCheck | None


def _without_odd(
    checks: _Checks, white: LightImage, correspondence: Correspondence, on_step: OnStep
) -> tuple[_Separated, tuple[str, ...]]:
    """Split white by all pictures, or by those that agree; with the names of the few that do not.

    Raises CalibrationError where more than a few do not agree, or some of the others neither.
    """
    found = _separated(checks, white, correspondence)
    odd = odd_among(found.crossed)
    if not odd.any():
        return found, ()
    if not are_few(odd):
        refuse_odd(found.crossed, checks.names)
    names = tuple(name for name, is_odd in zip(checks.names, odd, strict=True) if is_odd)
    on_step(f"left out, for the others make something else of them: {first_names(names)}", 1, 1)
    others = checks.without(odd)
    found = _separated(others, white, correspondence)
    refuse_odd(found.crossed, others.names)
    return found, names


def _processing_noise_dn(
    checks: _Checks, found: _Separated, white: tuple[LightImage, ExposureBracket], radiometric: RadiometricCalibration
) -> float:
    """What processing adds to pictures of checks, beyond noise as one frame of white has it; mosaics are raw."""
    if radiometric.mosaic is not None:
        return 0.0
    image, bracket = white
    direct, of_white = found.known.direct.mean(axis=-1), image.value.mean(axis=-1)
    usable, frames = _lit_by(direct, found.known), (frame.mean(axis=-1) for frame in checks.frames)
    scatter = scatter_in_middles(frames, checks.codes, found.finer, seen=found.seen, direct=direct, usable=usable)
    share = scatter.light / np.maximum(of_white[scatter.at], np.float32(1e-9))
    bands = image.value.shape[-1]
    variance = share * bracket.repeats * image.variance.mean(axis=-1)[scatter.at] / bands
    ratio = bracket.exposures_s[0] / radiometric.reference_exposure_s
    return scatter.beyond(variance, radiometric.light_of_a_dn(scatter.light * ratio) / (ratio * bands**0.5))


def processing_of_pictures_dn(session: Session) -> float:
    """Return what processing adds to pictures that are compared, which have softer edges than checks.

    On nine random rigs that send JPEG it added 0.2 to 0.6 of what it adds to checks to photographs, once 0.95.
    """
    return _OF_CHECKS * load_separation_record(session).processing_noise_dn


def calibration_of_pictures(session: Session) -> RadiometricCalibration:
    """Return how digital numbers become light in pictures that are compared, with what processing does to them."""
    return replace(load_radiometric_calibration(session), processing_noise_dn=processing_of_pictures_dn(session))


def _finer(correspondence: Correspondence, known: Separation) -> Correspondence:
    """The correspondence with the places that the checks' edges tell."""
    if known.projector_xy_px is None:
        raise ValueError("a separation by the known pattern has places")
    return replace(correspondence, projector_xy_px=known.projector_xy_px)


def _lit_by(direct: Float32Array, known: Separation) -> BoolArray:
    """(H, W) pixels whose direct light is valid and not small."""
    valid = known.valid.all(axis=-1)
    return np.asarray(valid & (direct > _LIT_SHARE * np.median(direct[valid])))


def _checker(
    step: Step, name: str, bracket: ExposureBracket, radiometric: RadiometricCalibration, *, lamp: LampRecord
) -> Float32Array:
    """(H, W, B) light of a checker, had the lamp been as bright as for white."""
    image = merge_raw_exposures(step, name, bracket, radiometric)
    return without_drift(image, lamp.at(time_of(step, name, bracket))).value


def _blur_of_stripes(session: Session) -> float | None:
    """How blurred stripes of the code are; None where it has none along both axes."""
    stripes = stripes_that_tell(
        list(find_code(session.profile.patterns.code).patterns(session.profile.projector.shape))
    )
    if not stripes:
        return None
    gray, radiometric = session.finished("gray"), load_radiometric_calibration(session)
    table = radiometric.table()
    white, black = (gray.load_frame(frame_name(name)).pixels for name in ("white", "black"))
    dark, correspondence = table[black].mean(axis=-1), load_correspondence(session)
    bright = np.asarray(table[white].mean(axis=-1) - dark)
    lit = _is_lit(bright) & (white < radiometric.saturation_dn).all(axis=-1)
    frames = [table[gray.load_frame(frame_name(each.name)).pixels].mean(axis=-1) - dark for each in stripes]
    spread = fit_point_spread(frames, [each.codes for each in stripes], correspondence, lit)
    return blur_of_picture_px(spread, correspondence, lit)


def _say(size_px: int, profile: Profile, on_step: OnStep, why: str) -> None:
    """Tell that checks are larger than was asked for."""
    if size_px != profile.patterns.checker_size_px:
        on_step(f"checks of {size_px} px: {why}", 1, 1)


def _told(names: Sequence[str], on_step: OnStep) -> Iterator[str]:
    """Go through names, and tell how far."""
    for k, name in enumerate(names):
        on_step("separate direct and global", k, len(names))
        yield name
    on_step("separate direct and global", len(names), len(names))


def _save(step: Step, white: LightImage, bright: Separation, known: Separation, *, mosaic: Mosaic | None) -> None:
    """Keep the light by the known pattern, and where that is not valid, by the brightest and darkest frames.

    Pixels of a mosaic were separated one by one, each with the light of its own filter; here they become bands.
    """
    direct, global_ = (
        np.where(known.valid, known.direct, bright.direct),
        np.where(known.valid, known.global_, bright.global_),
    )
    valid = known.valid.all(axis=-1)
    if mosaic is not None:
        direct, global_ = mosaic.interpolated(direct), mosaic.interpolated(global_)
        valid = ~mosaic.touched(~known.valid).any(axis=-1)
        white = white.in_bands(mosaic)
    step.save_image(
        "separation",
        {
            **layers("direct", direct),
            **layers("global", global_),
            **layers("white", white.value),
            **layers("white_variance", white.variance),
            "valid": (valid & ~white.any_saturated).astype(np.float32),
        },
        folder="maps",
    )


def _record(
    found: _Separated, *, checks: tuple[int, float | None, float], left_out: tuple[str, ...]
) -> SeparationRecord:
    extremes, direct = (part.direct.mean(axis=-1) for part in (found.bright, found.known))
    lit, spread = _lit_by(direct, found.known), found.spread
    sigmas = np.sqrt(np.diag(spread.covariance))
    return SeparationRecord(
        extremes_over_known_pattern=float(np.median(extremes[lit] / direct[lit])),
        projector_blur=_blur_record(spread.projector, sigmas[0]),
        camera_blur=_blur_record(spread.camera, sigmas[4]),
        checker_size_px=checks[0],
        stripes_blur_px=checks[1],
        camera_pixel_px=checks[2],
        checks_blur_px=blur_of_picture_px(spread, found.finer, lit),
        blur_rms=spread.rms,
        middle_percent=None if found.crossed is None else found.crossed.middle_percent,
        left_out=left_out,
    )


def _blur_record(blur: LensBlur, variance_sigma_px2: float) -> BlurRecord:
    height, width = blur.shape
    middle = float(blur.sigma_px(np.array([(width - 1) / 2, (height - 1) / 2])))
    corners = np.array([[0, 0], [width - 1, 0], [0, height - 1], [width - 1, height - 1]], dtype=np.float64)
    return BlurRecord(
        variance_px2=blur.coefficients_px2,
        middle_px=middle,
        middle_sigma_px=float(variance_sigma_px2 / (2 * max(middle, np.sqrt(variance_sigma_px2)))),
        worst_px=float(blur.sigma_px(corners).max()),
    )


def _blur_maps(found: _Separated, *, mosaic: Mosaic | None) -> dict[str, Float32Array]:
    """What each camera pixel sees of the projector picture: where, how wide, how much of white, how well separated."""
    known, finer, seen = found.known, found.finer, found.seen
    if known.variance is None or known.place_variance_px2 is None:
        raise ValueError("a separation by the known pattern has variances")
    sigma = variance_sigma_map(found.spread, finer).astype(np.float32)
    variance = np.where(np.isfinite(known.variance), known.variance, 0.0).astype(np.float32)
    return {
        "column": finer.projector_xy_px[..., 0],
        "row": finer.projector_xy_px[..., 1],
        "variance_x": seen.variance_px2[..., 0].astype(np.float32),
        "variance_y": seen.variance_px2[..., 1].astype(np.float32),
        "white_share": white_share(seen, finer.projector_shape).astype(np.float32),
        "variance_sigma_x": sigma[..., 0],
        "variance_sigma_y": sigma[..., 1],
        "place_variance": known.place_variance_px2,
        **layers("direct_variance", variance if mosaic is None else mosaic.interpolated_variance(variance)),
    }


def _separated(checks: _Checks, white: LightImage, correspondence: Correspondence) -> _Separated:
    grey = [frame.mean(axis=-1) for frame in checks.frames]
    spread = fit_point_spread(grey, checks.codes, correspondence, _lit(white))
    bright, known = _split(checks, white, correspondence, spread=spread)
    finer = _finer(correspondence, known)
    seen, direct = footprint_map(spread, finer), known.direct.mean(axis=-1)
    usable = _lit_by(direct, known)
    crossed = cross_check(grey, checks.codes, correspondence, seen=seen, direct=direct, usable=usable)
    if crossed is not None and crossed.middle_percent is not None:
        known = with_more_direct(known, crossed.middle_percent / 100, white=white.value)
    return _Separated(spread=spread, bright=bright, known=known, finer=finer, seen=seen, crossed=crossed)


def _split(
    checks: _Checks, white: LightImage, correspondence: Correspondence, *, spread: PointSpread
) -> tuple[Separation, Separation]:
    """By the brightest and darkest frames, and by the known pattern, (H, W, B) each."""
    found = []
    for b in range(white.value.shape[-1]):
        band = [np.ascontiguousarray(frame[..., b]) for frame in checks.frames]
        white_b = np.ascontiguousarray(white.value[..., b])
        known = separate_by_pattern(band, checks.codes, correspondence, white=white_b, spread=spread)
        found.append((separate(band, white=white_b), known))
    bright, known = (_joined(parts) for parts in zip(*found, strict=True))
    return bright, known


def _lit(white: LightImage) -> BoolArray:
    """(H, W) pixels that tell of the blur: not clipped, and not the darkest."""
    grey = white.value.mean(axis=-1)
    return np.asarray(~white.any_saturated & _is_lit(grey))


def _is_lit(white: Float32Array) -> BoolArray:
    return np.asarray(white > _LIT_SHARE * np.quantile(white, 0.9))


def _joined(bands: Sequence[Separation]) -> Separation:
    """All bands in one; the places are the first band's."""
    variances = [band.variance for band in bands if band.variance is not None]
    return Separation(
        direct=np.stack([band.direct for band in bands], axis=-1),
        global_=np.stack([band.global_ for band in bands], axis=-1),
        valid=np.stack([band.valid for band in bands], axis=-1),
        variance=np.stack(variances, axis=-1) if variances else None,
        projector_xy_px=bands[0].projector_xy_px,
        place_variance_px2=bands[0].place_variance_px2,
    )


def load_separation_record(session: Session) -> SeparationRecord:
    """Return the numbers of the finished step `separation`."""
    return session.finished("separation").load_record("separation", SeparationRecord)


def projector_blur_px2(session: Session) -> FloatArray:
    """Return (height, width) the variance of the projector's own blur at its pixels, as `separation` found it."""
    height, width = shape = session.profile.projector.shape
    blur = LensBlur(shape, load_separation_record(session).projector_blur.variance_px2)
    xy_px = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).astype(np.float64)
    return np.maximum(blur.variance_px2(xy_px), 0.0)
