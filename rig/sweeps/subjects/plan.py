"""The plan of a room as a subject: any key of its file may vary."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from rig.errors import UsageError
from rig.files.atomic import sha256_of
from rig.files.toml import toml_text
from rig.records import JsonObject, json_of
from rig.sweeps.records import Evaluated
from rig.sweeps.subjects.base_file import digest_of, figures_of, text_with

if TYPE_CHECKING:
    from rig.plan.request import PlanRequest

_NOT_FIGURES = ("projectors", "pixels", "remarks", "search")


class PlanSubject:
    """What ``rig plan`` says of a room, without its search: a sweep is one of its own."""

    version = "1"

    def base_of(self, name: str | None, near: Path) -> str:
        """Return the text of the room file, with the files that it names; raises ProfileError, UsageError."""
        from rig.plan.request import load_room
        from rig.plan.run import room_file

        if name is None:
            raise UsageError("base: missing; name a room file, or one that comes along, such as paper-room")
        beside = near / name
        room = load_room(room_file(beside if beside.is_file() else Path(name)).resolve())
        data = {key: value for key, value in room.as_json().items() if key != "search"}
        return toml_text(data) + "".join(f"# {file}: {sha256_of(file)}\n" for file in _files_of(room))

    def complete(self, settings: Mapping[str, object], base: str | None) -> JsonObject:
        """Return the settings and what the room is otherwise; raises ProfileError."""
        _request(settings, base)
        inputs: JsonObject = {key: json_of(value) for key, value in settings.items()}
        return {**inputs, "base": digest_of(base or "")}

    def evaluate(self, inputs: JsonObject, base: str | None) -> Evaluated:
        """Compute the plan, and return all its numbers as figures."""
        from rig.plan.compute import plan_room

        request = _request({key: value for key, value in inputs.items() if key != "base"}, base)
        return Evaluated(figures=dict(figures_of(plan_room(request).as_json(), _NOT_FIGURES)))


def _request(settings: Mapping[str, object], base: str | None) -> PlanRequest:
    from rig.plan.request import request_of

    return request_of(tomllib.loads(text_with(base or "", settings).decode()))


def _files_of(room: PlanRequest) -> list[Path]:
    """Files whose contents are part of what is asked: a mesh, pictures."""
    named = [room.room.mesh, *room.show.pictures]
    return [Path(name) for name in named if name is not None and Path(name).is_file()]
