"""The reference pages say what the code says."""

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, get_args, get_origin

import pytest
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from rig.cli.app import app
from rig.devices.simulated import settings as simulation_settings
from rig.profile import tables
from rig.profile.schema import Profile
from rig.run.steps import STEPS

ROOT = Path(__file__).parents[2]
ROW = re.compile(r"^\| `([a-z_0-9]+)` \| (.+?) \| (.+) \|$", re.MULTILINE)
PARTS_OF_BENCH = {
    "[[simulation.posters]]": simulation_settings.Poster,
    "[[simulation.material]]": simulation_settings.SimulatedMaterial,
    "[[simulation.camera]]": simulation_settings.SimulatedCameraSettings,
    "[[simulation.projector]]": simulation_settings.SimulatedProjectorSettings,
}
PARTS_OF_A_PROJECTOR = {"[projector.pjlink]": tables.PjlinkTable, "[projector.lightcrafter]": tables.LightCrafterTable}
SURFACES = (tables.Box, tables.Planes, tables.FreeSurface, tables.SurfaceFile)


def page(name: str) -> str:
    return (ROOT / "docs" / "reference" / name).read_text(encoding="utf-8")


def tables_of_the_code() -> dict[str, Mapping[str, FieldInfo]]:
    """Fields of each table of a profile, by the heading that the page gives it."""
    found: dict[str, Mapping[str, FieldInfo]] = {"Top level": {}}
    top: dict[str, FieldInfo] = {}
    for name, field in Profile.model_fields.items():
        key, model = field.alias or name, model_of(field)
        if model is None:
            top[key] = field
        elif key == "surface":
            found["[surface]"] = {}
            for surface in SURFACES:
                (kind,) = get_args(surface.model_fields["kind"].annotation)
                found[f'[surface] kind = "{kind}"'] = surface.model_fields
        else:
            found[f"[[{key}]]" if get_origin(field.annotation) is tuple else f"[{key}]"] = model.model_fields
        if key == "projector":
            found |= {name: part.model_fields for name, part in PARTS_OF_A_PROJECTOR.items()}
    found["Top level"] = top
    return found | {name: part.model_fields for name, part in PARTS_OF_BENCH.items()}


def model_of(field: FieldInfo) -> type[BaseModel] | None:
    options = [field.annotation, *get_args(field.annotation)]
    return next((o for o in options if isinstance(o, type) and issubclass(o, BaseModel)), None)


def sections(text: str) -> dict[str, str]:
    parts = re.split(r"^## ", text, flags=re.MULTILINE)[1:]
    return {part.partition("\n")[0].strip("` "): part for part in parts}


def as_written(value: Any) -> str:
    if value == {}:
        return "{}"
    if value is None:
        return "none"
    if isinstance(value, tuple):
        return "[" + ", ".join(map(as_written, value)) + "]"
    if isinstance(value, bool):
        return str(value).lower()
    return f'"{value}"' if isinstance(value, str) else repr(value)


def test_the_profile_page_has_exactly_the_tables_of_the_code() -> None:
    assert list(sections(page("profile.md"))) == list(tables_of_the_code())


@pytest.mark.parametrize("table", tables_of_the_code())
def test_the_profile_page_has_every_key_with_its_default(table: str) -> None:
    shown = {key: default for key, default, _ in ROW.findall(sections(page("profile.md"))[table])}
    real = {
        field.alias or key: (
            "required" if field.is_required() else as_written(field.get_default(call_default_factory=True))
        )
        for key, field in tables_of_the_code()[table].items()
    }
    assert shown == real


def test_the_command_line_page_has_exactly_the_verbs_of_the_code() -> None:
    verbs = {name for name in app if not name.startswith("-")}
    shown = {words.split()[1] for words in re.findall(r"^\| `(rig [^`]+)`", page("command-line.md"), re.MULTILINE)}
    assert shown == verbs


def test_the_command_line_page_shows_every_key_of_the_metrics(compared_session: Path) -> None:
    text = page("command-line.md").split("$ rig run runs/room --json\n")[1].split("```")[0]
    shown = json.loads(text)
    real = json.loads((compared_session / "metrics.json").read_text(encoding="utf-8"))
    assert set(shown) == set(real) | {"elapsed_s"}
    for part in ("geometry", "separation", "model", "compensation", "measured", "comparison", "truth"):
        assert set(shown[part]) == set(real[part]), part
    assert set(shown["measured"]["compensated"]) == set(real["measured"]["compensated"])


def test_the_session_page_names_every_step_in_order_and_no_file_that_is_not_there(compared_session: Path) -> None:
    text = page("session-folder.md")
    steps = re.findall(r"^\| `([a-z]+)` \|", sections(text)["Steps"], re.MULTILINE)
    assert steps == [step.name for step in STEPS]
    files = re.findall(r"`((?:maps|images|calibration)/[a-z0-9-]+-001\.(?:exr|json))`", text)
    assert len(files) > 10
    # Only with [transport].
    learned = {"calibration/transport-001.json", "maps/told-001.exr", "maps/lit-001.exr", "maps/uneven-001.exr"}
    assert [file for file in files if file not in learned and not (compared_session / file).is_file()] == []
