"""What a plan's numbers mean, in sentences."""

from __future__ import annotations

from dataclasses import replace

from rig.plan.records import PlanResult
from rig.plan.request import PlanRequest
from rig.plan.shown import colours_told

LITTLE_CONTRAST = 10.0
"""Checker contrast below which a picture looks washed out: ISO 15008 asks 5:1 of signs at night, films more."""
FEW_PATCHES = 100
"""In the paper's room 144 patches miss the mean white of 2,304 by 0.5 %, 64 by 1.2 %, 6 by 3 %."""
MUCH_GLOBAL = 0.3
"""Share of light from other walls from which on compensation is worth a look: the paper's room has 0.65."""


def remarks_on(result: PlanResult, request: PlanRequest) -> PlanResult:
    """Return the result with what a reader should know of it."""
    return replace(
        result,
        remarks=(
            *dict.fromkeys(said for one in result.projectors for said in one.said),
            *_brightness(result),
            *_contrast(result),
            *_worth(result),
            *_people(result),
            *_light(request),
            *_fineness(result, request),
            *colours_told(request.show.pictures),
        ),
    )


def _brightness(result: PlanResult) -> list[str]:
    all_, wanted = result.totals, result.totals.wanted_white_cdm2
    if all_.reached_share > 0.95:
        return [f"White reaches {wanted:g} cd/m² on {100 * all_.reached_share:.0f} % of the picture."]
    more = wanted / max(all_.white_cdm2 * all_.uniformity, 1e-9)
    return [
        f"White reaches the {wanted:g} cd/m² that are wanted on {100 * all_.reached_share:.0f} % of the picture only "
        f"(mean {all_.white_cdm2:.3g} cd/m²): try {more:.2g} times the lumens, brighter paint, a smaller picture, or "
        "less wanted."
    ]


def _contrast(result: PlanResult) -> list[str]:
    steps = result.contrast
    if steps.checker_in_room >= LITTLE_CONTRAST:
        return []
    walls = steps.checker_dark_room < 2 * steps.checker_in_room
    cause = "light between the walls, which darker paint lessens" if walls else "room light"
    return [f"A checker keeps a contrast of {steps.checker_in_room:.1f} : 1 only; what takes most of it is {cause}."]


def _worth(result: PlanResult) -> list[str]:
    said = []
    for picture in result.pictures:
        none, best = picture.outcome("none"), picture.outcome("bounded")
        said.append(
            f"{picture.name}: without compensation the error is {none.error:.1f} grey levels of 255, at best "
            f"{best.error:.1f}."
        )
    if result.totals.global_share > MUCH_GLOBAL:
        said.append(f"{100 * result.totals.global_share:.0f} % of white's light comes from other walls.")
    return said


def _people(result: PlanResult) -> list[str]:
    return [
        f"{one.person} stands in the picture: {100 * one.picture_share:.1f} % of it fall on them"
        + (", and into the face." if one.dazzled else ".")
        for one in result.shadows
        if one.picture_share > 0
    ]


def _fineness(result: PlanResult, request: PlanRequest) -> list[str]:
    if result.patches >= FEW_PATCHES:
        return []
    return [
        f"The room has {result.patches} patches only, and brightness may be some per cent off: give a smaller "
        f"room.patch_m than {request.room.patch_m:g}."
    ]


def _light(request: PlanRequest) -> list[str]:
    light = request.room_light
    shines = light.lux or light.lamp_lm or any(one.emits_cdm2 for one in request.opening)
    return [] if shines else ["No room light was given: the room is dark but for the projector."]
