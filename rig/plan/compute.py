"""A plan computed: one pure function from a request to a result."""

from __future__ import annotations

from dataclasses import dataclass

from rig.plan.light import LitRoom, lit_room
from rig.plan.measures import contrast_steps, surface_lights, totals
from rig.plan.people import people_of, shadow_of, sight_of
from rig.plan.records import PlanResult, PlanTotals
from rig.plan.remarks import remarks_on
from rig.plan.request import PlanRequest
from rig.plan.shown import PictureInRoom, checked_strategies, picture_in_room
from rig.terminal import OnStep, silent

_STEP = "light, pictures and viewers"


@dataclass(frozen=True, eq=False, kw_only=True)
class ComputedPlan:
    """A result with the arrays that its page shows."""

    request: PlanRequest
    lit: LitRoom
    pictures: tuple[PictureInRoom, ...]
    result: PlanResult


def plan_room(room: PlanRequest) -> PlanResult:
    """Return what a room will be like: brightness, contrast, interreflection, errors without and with compensation.

    A pure function: the same request gives the same result, in any process. Pictures in files are read.

    Parameters
    ----------
    room
        From :func:`rig.load_room` or :func:`rig.plan.request.request_of`.

    Returns
    -------
    PlanResult
        ``as_json()`` makes one JSON object of it.

    Raises
    ------
    UsageError
        For anything in the request that cannot be: what, which number against which limit, what to try.
    """
    return computed_plan(room).result


def computed_plan(request: PlanRequest, on_step: OnStep = silent) -> ComputedPlan:
    """Return a plan's result and arrays; as :func:`plan_room`."""
    show = request.show
    total = 2 + len(show.pictures)
    on_step(_STEP, 0, total)
    strategies = checked_strategies(show.strategies)
    lit = lit_room(request)
    pictures = []
    for k, name in enumerate(show.pictures, 1):
        on_step(_STEP, k, total)
        pictures.append(picture_in_room(lit, name, show.white_cdm2, strategies))
    on_step(_STEP, total - 1, total)
    shadows = tuple(shadow_of(lit, person) for person in people_of(request, lit))
    viewers = tuple(sight_of(lit, viewer, pictures[0], show.white_cdm2) for viewer in request.viewer)
    summary: PlanTotals = totals(lit, show.white_cdm2)
    result = PlanResult(
        name=request.name,
        projectors=tuple(one.numbers for one in lit.views),
        patches=lit.room.surface.n_patches,
        pixels=(lit.views[0].lens.width_px, lit.views[0].lens.height_px),
        totals=summary,
        contrast=contrast_steps(lit),
        surfaces=surface_lights(lit),
        pictures=tuple(one.record for one in pictures),
        shadows=shadows,
        viewers=viewers,
        remarks=(),
    )
    on_step(_STEP, total, total)
    return ComputedPlan(request=request, lit=lit, pictures=tuple(pictures), result=remarks_on(result, request))
