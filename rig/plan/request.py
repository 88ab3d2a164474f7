"""What a plan is asked for: the tables of ``ROOM.toml``, checked one by one."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, TypeGuard

from pydantic import Field

from rig.errors import ProfileError
from rig.files.toml import Table, check_model, entry_place, parse_toml
from rig.plan.search.request import SearchTable
from rig.records import JsonObject

Coordinate = Annotated[float, Field(ge=-1000, le=1000)]
"""Of a place: no room reaches farther from its own corner. [m]"""
Edge = Annotated[float, Field(ge=0.1, le=300)]
"""Of a room: from a model of one to an exhibition hall. [m]"""
Lumens = Annotated[float, Field(ge=1, le=200_000)]
"""From a pocket projector to twice the largest of cinemas. [lm]"""
Cost = Annotated[float, Field(ge=0, le=1e9)]
PersonHeight = Annotated[float, Field(ge=0.3, le=2.8)]
"""From a child that crawls to the tallest who ever stood (2.72 m). [m]"""
Pixels = Annotated[int, Field(ge=16, le=16_384)]
Share = Annotated[float, Field(ge=0.001, le=0.99)]
"""A reflectance: nothing on a wall is blacker than 0.001, and above 0.99 light would hardly fade."""
Text = Annotated[str, Field(min_length=1)]
Point = tuple[Coordinate, Coordinate, Coordinate]
Paint = float | str
Unit = Literal["m", "cm", "mm", "in", "inch", "ft"]
UpAxis = Literal["x", "y", "z", "-x", "-y", "-z"]
BoxFace = Literal["floor", "ceiling", "x0", "x1", "y0", "y1"]


class RoomShape(Table):
    """``[room]``: a box by its size, a scene of the library, or a mesh file."""

    size_m: tuple[Edge, Edge, Edge] | None = None
    """Along x, y and z. [m]"""
    surfaces: tuple[BoxFace, ...] = ("floor", "ceiling", "x0", "x1", "y0", "y1")
    """Of a box, those that there are."""
    scene: Text | None = None
    """A name that ``rig simulate`` knows."""
    mesh: Text | None = None
    """A mesh file; from the plan's folder."""
    unit: Unit | None = None
    up: UpAxis | None = None
    patch_m: Annotated[float, Field(ge=0.02, le=10)] = 0.4
    """Wanted size of the patches. [m]"""


class NamedPaint(Table):
    """``[[named_paint]]``: a paint of one's own."""

    name: Text
    reflectance: Share
    """Luminous: a colour card's LRV over 100."""
    cost: Cost = 0.0
    """A square metre, in any currency."""
    source: str = ""
    """Who measured it."""


class Opening(Table):
    """``[[opening]]``: a window, a door, a lamp's panel in a surface of a box."""

    name: Text
    surface: BoxFace
    from_m: tuple[Coordinate, Coordinate]
    """Lower left corner seen from inside: along the wall, and up; on floor and ceiling along the face's axes. [m]"""
    to_m: tuple[Coordinate, Coordinate]
    """Upper right corner. [m]"""
    paint: Paint = "window-glass"
    emits_cdm2: Annotated[float, Field(ge=0, le=1e6)] = 0.0
    """Its own luminance, the same in all directions: sunlit clouds have 10,000. [cd/m²]"""


class RoomLight(Table):
    """``[room_light]``: what shines beside projector and openings; one of the two."""

    lux: Annotated[float, Field(ge=0, le=200_000)] | None = None
    """As a meter reads it on every surface with the projector off, whatever the paint; the sun makes 100,000. [lx]"""
    lamp_lm: Annotated[float, Field(ge=0, le=1e7)] | None = None
    """Of lamps that shine alike on all surfaces; these pass it on, so that dark paint keeps the room dark. [lm]"""


class PlannedProjector(Table):
    """``[[projector]]``: a model of hw_profiles/projectors, numbers, or both; numbers go first."""

    name: Text | None = None
    """What tables and figures call it where there are several."""
    model: Text | None = None
    throw_ratio: Annotated[float, Field(gt=0)] | None = None
    """Distance over picture width."""
    lens_shift: tuple[float, float] = (0.0, 0.0)
    """Of the picture against the optical axis, to the right and up, in shares of its width and height."""
    lumens: Lumens | None = None
    """Of full white. [lm]"""
    contrast: Annotated[float, Field(gt=1, le=1e7)] | None = None
    """Full white over full black, the projector alone."""
    width_px: Pixels | None = None
    height_px: Pixels | None = None
    position_m: Point
    """Of the lens. [m]"""
    look_at_m: Point
    """A point on the optical axis. [m]"""
    roll_deg: Annotated[float, Field(ge=-360, le=360)] = 0.0
    cost: Cost = 0.0
    """In the currency of the paints."""


class PlannedViewer(Table):
    """``[[viewer]]``: an eye; ``stands`` for a person below it who throws a shadow."""

    name: Text
    eye_m: Point
    stands: bool = False


class PlannedPerson(Table):
    """``[[person]]``: somebody who stands in the room, a cylinder from the floor up."""

    name: Text
    at_m: tuple[Coordinate, Coordinate]
    height_m: PersonHeight = 1.75
    radius_m: Annotated[float, Field(ge=0.05, le=1)] = 0.25


class WantedPictures(Table):
    """``[show]``: what is wanted on the walls."""

    white_cdm2: Annotated[float, Field(ge=0.01, le=10_000)]
    """Luminance that the pictures' white shall have, whatever the paint. [cd/m²]"""
    pictures: Annotated[tuple[Text, ...], Field(min_length=1)] = ("outdoor", "indoor", "grey")
    """``outdoor``, ``indoor``, ``grey``, ``white``, ``checker``, ``grey:0.5``, or picture files."""
    strategies: tuple[Text, ...] = ("direct", "paper", "exact", "bounded")
    """Beside ``none``; ``bounded`` is always asked for what cannot be reached."""
    width_px: Annotated[int, Field(ge=16, le=1920)] = 160
    """Of the pictures that are computed; the projector's own pixels are counted all the same."""


class PlanRequest(Table):
    """A room, a projector and what is wanted of them; frozen, equal by value, and the same as ``ROOM.toml``."""

    schema_: Annotated[Literal[1], Field(alias="schema")] = 1
    name: Text = "room"
    room: RoomShape
    paint: Mapping[str, Paint] = Field(default_factory=lambda: {"all": 0.7})
    """By surface: a name or a reflectance; ``walls`` for upright ones, ``all`` for the others."""
    named_paint: tuple[NamedPaint, ...] = ()
    opening: tuple[Opening, ...] = ()
    room_light: RoomLight = RoomLight()
    projector: Annotated[tuple[PlannedProjector, ...], Field(min_length=1)]
    """``[projector]`` is a list of one."""
    projectors_used: Annotated[int, Field(ge=1)] | None = None
    """Only so many of them, from the first; None: all. A search may ask how many are worth it."""
    viewer: tuple[PlannedViewer, ...] = ()
    person: tuple[PlannedPerson, ...] = ()
    show: WantedPictures
    search: SearchTable | None = None

    @property
    def projectors(self) -> tuple[PlannedProjector, ...]:
        """Those that are used."""
        return self.projector[: self.projectors_used]

    def place_of(self, index: int) -> str:
        """Return what messages call a projector's table: by its name or number, where there are several."""
        if len(self.projector) == 1:
            return "projector"
        return f"projector.{self.projector[index].name or index + 1}"

    def as_json(self) -> JsonObject:
        """Return all that differs from nothing, as ``ROOM.toml`` has it.

        Returns
        -------
        JsonObject
            What :func:`request_of` takes.
        """
        made: JsonObject = self.model_dump(mode="json", by_alias=True, exclude_none=True)
        return made


def load_room(path: Path) -> PlanRequest:
    """Read ``ROOM.toml``; names of files in it are taken from its folder.

    Parameters
    ----------
    path
        Of the file.

    Returns
    -------
    PlanRequest

    Raises
    ------
    ProfileError
        A line for each thing that is wrong with it.
    """
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise ProfileError(f"{path}: cannot be read: {error.strerror}; give a room file (TOML)") from error
    data = _with_list(parse_toml(raw, path))
    request = check_model(PlanRequest, data, path, _cross_checks(data))
    return _with_whole_paths(request, path.parent)


def request_of(data: dict[str, Any], folder: Path | None = None) -> PlanRequest:
    """Return the request that a TOML's data (or :meth:`PlanRequest.as_json`) say.

    Parameters
    ----------
    data
        Of a room file.
    folder
        From which names of files are taken; None: as they stand.

    Raises
    ------
    ProfileError
        A line for each thing that is wrong with it.
    """
    whole = _with_list(data)
    request = check_model(PlanRequest, whole, Path("room"), _cross_checks(whole))
    return request if folder is None else _with_whole_paths(request, folder)


def _with_list(data: dict[str, Any]) -> dict[str, Any]:
    """The same with one projector as a list of one."""
    one = data.get("projector")
    return {**data, "projector": [one]} if isinstance(one, dict) else data


def _cross_checks(data: dict[str, Any]) -> list[str]:
    """What no single table shows."""
    problems = []
    room, light, show = (_table(data, key) for key in ("room", "room_light", "show"))
    kinds = [key for key in ("size_m", "scene", "mesh") if key in room]
    if len(kinds) != 1:
        problems.append(f"room: {' and '.join(kinds) or 'nothing'} given; give one of size_m, scene, mesh")
    if "lux" in light and "lamp_lm" in light:
        problems.append("room_light: lux and lamp_lm say the same thing; give what you measured, or what you install")
    problems += _projector_problems(data)
    if show and "white_cdm2" not in show:
        problems.append(
            "show.white_cdm2: missing; say how bright white shall look: 48 as in a cinema, 10 ... 20 where "
            "one projector fills a room"
        )
    if "opening" in data and "size_m" not in room:
        problems.append("opening: known in a box only (room.size_m); a mesh brings its own windows")
    problems += [*_coarse(room), *_same_pictures(show)]
    return problems + [line for key in ("named_paint", "viewer", "person") for line in _twice(data, key)]


def _coarse(room: dict[str, Any]) -> list[str]:
    """A patch that is larger than the room."""
    size, patch_m = room.get("size_m"), room.get("patch_m")
    numbers = isinstance(size, list) and all(type(one) in (int, float) for one in (*size, patch_m))
    if not size or not numbers or patch_m <= max(size):
        return []
    return [f"room.patch_m: {patch_m:g} m is longer than the room ({max(size):g} m); give a tenth of it or less"]


def _twice(data: dict[str, Any], key: str) -> list[str]:
    """Names that two tables of a kind have: figures and messages could not tell them apart."""
    given = data.get(key)
    names = [str(one["name"]) for one in given if isinstance(one, dict) and "name" in one] if _is_list(given) else []
    twice = [name for name in dict.fromkeys(names) if names.count(name) > 1]
    return [f"{key}.{name}.name: is there twice; give each its own" for name in twice]


def _same_pictures(show: dict[str, Any]) -> list[str]:
    """Pictures that figures could not tell apart: files of one name in two folders, or one picture twice."""
    given = show.get("pictures")
    names = [Path(one).name for one in given if isinstance(one, str)] if _is_list(given) else []
    twice = [name for name in dict.fromkeys(names) if names.count(name) > 1]
    return [f"show.pictures: {name} is there twice; leave one out, or give files other names" for name in twice]


def _is_list(value: object) -> TypeGuard[list[Any]]:
    return isinstance(value, list)


def _projector_problems(data: dict[str, Any]) -> list[str]:
    """What is wrong with the projectors beside each other."""
    given = data.get("projector")
    tables = [one for one in given if isinstance(one, dict)] if isinstance(given, list) else []
    problems = [
        f"projector{entry_place(tables, k)}.lumens: missing; give the lumens of white, or a model of "
        "hw_profiles/projectors"
        for k, one in enumerate(tables)
        if "lumens" not in one and "model" not in one
    ]
    problems += _twice(data, "projector")
    used = data.get("projectors_used")
    if isinstance(used, int) and used > len(tables) > 0:
        problems.append(f"projectors_used: {used}, but there are {len(tables)}; give no more, or describe the others")
    return problems


def _table(data: dict[str, Any], key: str) -> dict[str, Any]:
    value = data.get(key)
    return value if isinstance(value, dict) else {}


def _with_whole_paths(request: PlanRequest, folder: Path) -> PlanRequest:
    """The same with files named from where the command runs."""
    room = request.room
    if room.mesh is not None:
        room = room.model_copy(update={"mesh": str(folder / room.mesh)})
    pictures = tuple(
        str(folder / name) if "." in Path(name).name and ":" not in name else name for name in request.show.pictures
    )
    show = request.show.model_copy(update={"pictures": pictures})
    return request.model_copy(update={"room": room, "show": show})
