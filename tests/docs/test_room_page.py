"""The page of the room file has exactly the keys of the code."""

import re
from pathlib import Path

import pytest
from pydantic import BaseModel

from rig.plan import request
from rig.plan.search import request as search

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "room.md"
TABLES: dict[str, type[BaseModel]] = {
    "Top level": request.PlanRequest,
    "[room]": request.RoomShape,
    "[[named_paint]]": request.NamedPaint,
    "[[opening]]": request.Opening,
    "[room_light]": request.RoomLight,
    "[[projector]]": request.PlannedProjector,
    "[[viewer]]": request.PlannedViewer,
    "[[person]]": request.PlannedPerson,
    "[show]": request.WantedPictures,
    "[search]": search.SearchTable,
    "[[search.free]]": search.FreeParameter,
    "[[search.goal]]": search.SearchGoal,
    "[[search.keep_out]]": search.KeepOut,
}


@pytest.mark.parametrize("table", TABLES)
def test_every_key_of_the_room_file_has_its_row(table: str) -> None:
    chapters = re.split(r"^## ", PAGE.read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]
    text = next(one for one in chapters if one.partition("\n")[0] == table)
    first = [row.split("|")[1] for row in text.splitlines() if row.startswith("| `")]
    shown = {key for cell in first for key in re.findall(r"`([a-z_0-9]+)`", cell)}
    assert shown == {field.alias or key for key, field in TABLES[table].model_fields.items()}
