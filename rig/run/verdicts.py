"""What a session is judged by: its numbers against the limits of its profile."""

from __future__ import annotations

from dataclasses import replace

from calibration.geometry.planes import USUAL_ASKEW_DEG
from calibration.light.check_size import large_enough_px
from rig.profile.schema import Profile
from rig.profile.tables import Limits
from rig.records import Verdict
from rig.run.certainty import SURER, length_advice, length_sigma_percent, place_advice, place_sigma_percent
from rig.stages.light.exposure import CameraExposure
from rig.stages.light.odd_checks import first_names
from rig.stages.light.records import SeparationRecord
from rig.stages.results import GeometryResult, ModelComparison, ModelResult
from rig.stages.stripes.showing import focus_verdicts, out_of_focus
from rig.stages.stripes.superposition import superposition_verdicts

_MOST_AGAINST_RIGHT_ANGLES = 3.0
"""Standard deviations: of thirty random rooms 1.4 at most, of corners of 93 to 96 degrees, which were up to 10 % of the
room off, 2.5 to 4.2."""
_SQUARE_PERCENT, _MOST_OFF_PERCENT = 0.01, 1.0
"""Of the room: where walls are as square as a box's, and off by more than which a length is called wrong."""
_OF_NOISE = 1.25
"""Of the noise part: a camera of few electrons is no worse a model."""
_LEAST_WITHIN_3_SIGMA = 0.85
"""Share of a picture: noise alone leaves 0.997, stated deviations of half the true ones 0.866. In a random world with
three columns in a row, behind which nobody saw, the half-lit picture had 0.71 and white 0.98."""
_ONCE_IN_A_HUNDRED = 2.58
"""Standard deviations. A session at its limit of 0.385 % is off by 1 % so often."""
_UNEXPLAINED_GLOBAL = 0.12
"""Of 20 random rooms, those at 0.07 and below had reflectances within 0.04, those at 0.17 and above 0.12 to 0.3 off."""
_SWELL_PERCENT = 0.4
"""Of white, from darkest to brightest: one grey level of 255."""
_LATE_PERCENT = 0.4
"""Of the picture before, left in the first photograph of another: one grey level of 255."""
_LEAST_SIDE = 6.0
"""Standard deviations of blur in a check. Below, direct and global light are up to 1.7 and 4.1 % off, with JPEG 2 and 6
(`calibration.light.check_size`)."""
_MIDDLE_PERCENT = 1.0
"""Of direct light. On 13 random rigs it was 0.4 at most; a camera that sharpens by 0.6 had 3.3, and 4.6 too much."""
_ADVICE_ONE_WALL = (
    "the rest of the room, which the model has not, sends light back to the wall unevenly: show a corner, so that the "
    "surfaces near by are modelled, or cover what is bright beside the wall"
)


def verdicts(
    geometry: GeometryResult, model: ModelResult, comparison: ModelComparison, profile: Profile
) -> tuple[Verdict, ...]:
    """Return what a finished session is judged by, without the lamp."""
    return (
        *geometry_verdicts(geometry, profile.limits),
        _guesses(geometry, model, profile),
        _valid(geometry, profile.limits),
        _explained(geometry, model, profile.limits),
        *_compared(comparison, profile.limits),
    )


def geometry_verdicts(geometry: GeometryResult, limits: Limits) -> tuple[Verdict, ...]:
    """Return what lenses, poses and walls are judged by: all that a person would call wrong has a limit."""
    return (
        Verdict(
            what="geometry: reprojection rms",
            value=geometry.rms_px,
            limit=limits.geometry_rms_px,
            unit="px",
            advice=out_of_focus(geometry.stripes_times)
            or "nothing may move while it is calibrated; look whether the walls are flat and stand at right angles",
        ),
        Verdict(
            what="geometry: uncertainty of the room's lengths",
            value=length_sigma_percent(geometry),
            limit=limits.geometry_sigma_percent,
            unit="%",
            advice=length_advice(geometry),
        ),
        Verdict(
            what="geometry: uncertainty of the places of devices and surfaces",
            value=place_sigma_percent(geometry),
            limit=limits.geometry_sigma_percent,
            unit="% of the room",
            advice=place_advice(geometry),
        ),
        Verdict(
            what="geometry: what the least certain length or place is off by, once in a hundred",
            value=_ONCE_IN_A_HUNDRED * max(length_sigma_percent(geometry), place_sigma_percent(geometry)),
            unit="%",
        ),
        *_off_walls(geometry),
        *_right_angles(geometry),
        *_rests_on_right_angles(geometry),
        *focus_verdicts(geometry.stripes_times),
        *superposition_verdicts(geometry.superposition_percent),
    )


def _off_walls(geometry: GeometryResult) -> tuple[Verdict, ...]:
    """Return how far walls that are a little askew are from the box that stands for them; nothing of square ones."""
    percent = 100 * geometry.off_walls_m / max(geometry.room_size_m)
    if percent < _SQUARE_PERCENT:
        return ()
    return (
        Verdict(
            what="geometry: how far the measured walls are off the box that stands for them",
            value=percent,
            limit=_MOST_OFF_PERCENT,
            unit="% of the room",
            advice="a wall leans, or a corner is not square, and a box stands elsewhere than the walls: model them as "
            'they are ([surface] kind = "free"), or aim at walls that are square',
        ),
    )


def _right_angles(geometry: GeometryResult) -> tuple[Verdict, ...]:
    """Return what speaks against right angles; beyond four standard deviations step `geometry` refuses them."""
    if geometry.right_angle_sigmas is None:
        return ()
    return (
        Verdict(
            what="geometry: what points and fields of view say against right angles",
            value=max(geometry.right_angle_sigmas, 0.0),
            limit=_MOST_AGAINST_RIGHT_ANGLES,
            unit="sigma",
            advice="walls that are not square make focal lengths and all that was measured wrong: check hfov_deg of "
            "both devices (zoom, crop, horizontal or diagonal), and the corners by a set square; where they are not "
            "square, set surface.right_angles = false, and give both devices a lens file (rig lenses)",
        ),
    )


def _rests_on_right_angles(geometry: GeometryResult) -> tuple[Verdict, ...]:
    """Return what walls that stand a little askew would cost: no points tell it where they are taken to be square."""
    if geometry.askew_sigmas is None:
        return ()
    askew = replace(geometry, sigmas=geometry.askew_sigmas)
    percent = max(length_sigma_percent(askew), place_sigma_percent(askew))
    return (
        Verdict(
            what=f"geometry: what the least certain length or place is off by, if walls are {USUAL_ASKEW_DEG:g}° askew",
            value=percent,
            unit="%",
            advice="right_angles = true is taken as exact; say how far from square walls may stand "
            f"(surface.askew_deg), and it counts in all uncertainties. To make it less: {SURER}",
        ),
    )


def room_light_verdicts(exposure: CameraExposure) -> tuple[Verdict, ...]:
    """Return what room light that swells faster than an exposure ends is judged by: each frame has another share of it.

    Where means over frames a third of its period apart have less of it, they are what is judged. Nothing where no such
    light was seen, or exposures hold whole periods of it.
    """
    if exposure.room_light_hz is None or not exposure.swell_percent:
        return ()
    period_ms = 1000 / exposure.room_light_hz
    return (
        Verdict(
            what=f"room light: swell at {exposure.room_light_hz:g} Hz from "
            f"{'frame to frame' if exposure.averaged_hz is None else 'one mean of three frames to the next'}",
            value=exposure.swell_percent if exposure.averaged_hz is None else exposure.swell_left_percent or 0.0,
            limit=_SWELL_PERCENT,
            unit="% of white",
            advice=f"white needs an exposure of {1000 * exposure.exposure_s:.1f} ms, and one of {period_ms:.1f} ms, a "
            "whole period of this light, would clip it: switch the room light off, or let less light into the camera "
            "(iris, grey filter) so that exposures hold whole periods; frames a third of its period apart, whose mean "
            "has none of it, need a frame rate that does not divide it",
        ),
    )


def lateness_verdicts(exposure: CameraExposure) -> tuple[Verdict, ...]:
    """Return what is judged of photographs that still have some of the picture before; nothing where nobody looked."""
    if exposure.late_percent is None:
        return ()
    return (
        Verdict(
            what="photographs: light of the picture before",
            value=exposure.late_percent,
            limit=_LATE_PERCENT,
            unit="% of white",
            advice="photographs begin before the picture is wholly on: raise projector.latency_s (rig check measures "
            "it); a display that glows on, smooth motion, and noise reduction in the camera do the same",
        ),
    )


def checks_verdicts(separation: SeparationRecord) -> tuple[Verdict, ...]:
    """Return what checks are judged by: their size, light beside edges where they have a middle, odd pictures."""
    return (*_size(separation), *_beside_edges(separation), *_left_out(separation))


def _size(separation: SeparationRecord) -> tuple[Verdict, ...]:
    blur_px = separation.checks_blur_px
    if not blur_px:
        return ()
    return (
        Verdict(
            what="separation: side of a check over the blur of the picture",
            value=separation.checker_size_px / blur_px,
            limit=_LEAST_SIDE,
            unit="standard deviations",
            at_least=True,
            advice=f"a camera pixel sees the picture blurred by {blur_px:.1f} px, and checks of "
            f"{separation.checker_size_px} px are too fine for that: direct and global light are biased. Focus both "
            f"lenses, or set patterns.checker_size_px = {large_enough_px(blur_px)}, and begin a new session",
        ),
    )


def _left_out(separation: SeparationRecord) -> tuple[Verdict, ...]:
    """Nothing where every picture is what the others make of it."""
    if not separation.left_out:
        return ()
    return (
        Verdict(
            what="separation: pictures of checks left out",
            value=len(separation.left_out),
            advice=f"{first_names(separation.left_out)}: the others agree, and light was separated by them. Somebody "
            "or something stood in the light, or light in the room changed, while these were photographed: stay away, "
            "and keep the room dark",
        ),
    )


def _beside_edges(separation: SeparationRecord) -> tuple[Verdict, ...]:
    if separation.middle_percent is None:
        return ()
    return (
        Verdict(
            what="separation: direct light by the middles of checks, against that by all of them",
            value=abs(separation.middle_percent),
            limit=_MIDDLE_PERCENT,
            unit="%",
            advice="light beside the edges of checks is not what a lens leaves there: the camera sharpens its pictures "
            "or compresses them too much, a lens is dirty, or something moved. Set the camera's sharpness (detail, "
            "edge enhancement, picture style) to the least, take raw frames or better JPEG, clean both lenses, and "
            "begin a new session; larger checks (patterns.checker_size_px) suffer less",
        ),
    )


def _guesses(geometry: GeometryResult, model: ModelResult, profile: Profile) -> Verdict:
    most_m = profile.limits.geometry_sigma_percent / 100 * max(geometry.room_size_m)
    guessed = _guessed_axes(geometry, model, most_m) if profile.room.closed else []
    return Verdict(
        what="geometry: directions in which a wall's place is guessed",
        value=len(guessed),
        limit=0,
        unit="",
        advice=f"the light tells it {_by_light(model)}; {'; '.join(_where(axis, geometry) for axis in guessed)}",
    )


def _where(axis: str, geometry: GeometryResult) -> str:
    """What nobody saw or measured along an axis, and what would tell it."""
    low, high = ("floor", "ceiling") if axis == "z" else (f"{axis}0", f"{axis}1")
    if high in geometry.faces_seen:
        return f"{low}, opposite {high}, was neither seen nor measured: give surface.size_m by tape, or show {low}"
    if axis == "z":
        return (
            "neither floor nor ceiling was seen: show one of them, or give surface.lens_height_m, the projector's lens "
            "above the floor by tape"
        )
    return f"neither {low} nor {high} was seen: show one of them"


def _valid(geometry: GeometryResult, limits: Limits) -> Verdict:
    return Verdict(
        what="valid share of the lit pixels",
        value=geometry.valid_share,
        limit=limits.valid_share,
        at_least=True,
        advice="focus the projector and the camera, darken the room, and keep glossy things out of the picture",
    )


def _explained(geometry: GeometryResult, model: ModelResult, limits: Limits) -> Verdict:
    """What the patches leave open of global light; with photographs of known pictures, what these leave open.

    That is measured: each photograph against what all others make of it, or what follows for usual pictures if more.
    """
    if model.learned is not None and model.learned.photographs:
        return Verdict(
            what="model: photographs of [transport], each by the others, rms",
            value=max(model.learned.rms_left, model.learned.left_out_rms),
            limit=limits.comparison_rmse,
            unit="grey levels",
            advice="the photographs contradict each other, or tell too little of the light: nothing may move or be "
            "switched while they are taken; take more (transport.photographs), or average several frames of each "
            "(patterns.frames_averaged)",
        )
    return Verdict(
        what="model: global light left unexplained, rms",
        value=max(model.global_rms) if isinstance(model.global_rms, tuple) else model.global_rms,
        limit=_UNEXPLAINED_GLOBAL,
        unit="",
        advice=_ADVICE_ONE_WALL
        if len(geometry.faces_seen) == 1
        else "no reflectance explains the light between the walls: check surface.size_m of walls that nobody "
        "sees, show the floor or the ceiling, and look for things that are no walls",
    )


def _compared(comparison: ModelComparison, limits: Limits) -> tuple[Verdict, ...]:
    worst = min(comparison.frames, key=lambda name: comparison.frames[name].within_3_sigma)
    return (
        Verdict(
            what="measured - simulated: rms",
            value=comparison.rmse,
            limit=max(limits.comparison_rmse, _OF_NOISE * comparison.noise_rms),
            unit="grey levels",
            advice="look at the report's error pictures: what is not a wall of the room, or shines, is not in the "
            "model (transport.photographs teach it the light)",
        ),
        Verdict(
            what="measured - simulated: |bias|",
            value=abs(comparison.bias),
            limit=limits.comparison_bias,
            unit="grey levels",
            advice="let the projector warm up, and switch everything automatic off in both devices",
        ),
        Verdict(
            what="measured - simulated: within 3 sigma, least of all pictures",
            value=comparison.frames[worst].within_3_sigma,
            limit=_LEAST_WITHIN_3_SIGMA,
            unit="of the pixels",
            at_least=True,
            advice=f"the model's own standard deviations do not cover what {worst} shows: light goes where nothing was "
            "seen of the room (behind things, beyond the picture), something moved, something shines, or a lens is "
            "dirty and has halos. Look at that picture's errors; show the rig more of the room, or teach it the light "
            "(transport.photographs)",
        ),
    )


def _guessed_axes(geometry: GeometryResult, model: ModelResult, most_m: float) -> list[str]:
    """Those along which no wall was seen or measured, so that a device's place has no sigma, nor told by the light."""
    told = {one.axis for one in model.placed if one.sigma_m <= most_m}
    return [axis for axis in "xyz" if f"projector_{axis}_m" not in geometry.sigmas and axis not in told]


def _by_light(model: ModelResult) -> str:
    """How well, in words."""
    if not model.placed:
        return "badly"
    return "to " + " and ".join(f"{one.sigma_m:.2f} m along {one.axis}" for one in model.placed) + " only"
