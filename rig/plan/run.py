"""``rig plan``: read a room file, compute, search, write the page."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from rig.errors import UsageError
from rig.files.atomic import check_output
from rig.plan.compute import computed_plan
from rig.plan.page import write_plan_page
from rig.plan.records import PlanResult
from rig.plan.request import PlanRequest, load_room
from rig.plan.search.run import search_designs
from rig.plan.search.words import result_of
from rig.profile.hardware_facts import FOLDER
from rig.terminal import OnStep, silent

ROOMS = FOLDER / "rooms"


def room_file(name: Path) -> Path:
    """Return the file of a room: itself, or one of ``hw_profiles/rooms`` by its bare name.

    Raises
    ------
    UsageError
        There is neither; the message lists the rooms that come along.
    """
    if name.is_file():
        return name
    own = ROOMS / f"{name}.toml"
    if own.is_file() and len(name.parts) == 1:
        return own
    known = ", ".join(sorted(path.stem for path in ROOMS.glob("*.toml")))
    raise UsageError(f"{name}: no such room file; give one (docs/how-to/plan-a-room.md), or one of {known}")


def run_plan(
    request: PlanRequest | Path, page: Path | None = None, on_step: OnStep = silent, *, search: bool = True
) -> PlanResult:
    """Compute a plan, look for better designs if the room file asks for them, and write the page.

    Parameters
    ----------
    request
        A request or a room file.
    page
        HTML file to write; None: none.
    on_step
        Told how far it is.
    search
        False: without the search.

    Raises
    ------
    UsageError
        For anything in the request that cannot be.
    """
    wanted = load_room(room_file(request)) if isinstance(request, Path) else request
    if page is not None:
        check_output(page)
    computed = computed_plan(wanted, on_step)
    if search and wanted.search is not None:
        designs = result_of(search_designs(wanted, on_step=on_step))
        computed = replace(computed, result=replace(computed.result, search=designs))
    if page is not None:
        on_step("page", 0, 1)
        write_plan_page(computed, page)
        on_step("page", 1, 1)
    return computed.result
