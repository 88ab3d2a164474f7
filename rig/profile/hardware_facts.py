"""What public documents say of cameras and projectors: one TOML file a model, a source and a quotation for each fact.

A fact that nobody can cite has no place here: its key is listed under ``to_be_measured`` instead.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Any, Generic, Literal, TypeVar

from pydantic import Field

from rig.errors import ProfileError
from rig.files.toml import Table, parse_toml, read_model

FOLDER = Path(__file__).parents[2] / "hw_profiles"
KINDS = ("camera", "projector")
MEASURED_ONLY = {
    "camera": ("linearity", "black_level_dn", "frame_latency_s"),
    "projector": ("latency_s", "response", "additivity", "black_level"),
}
"""Not in any data sheet that can be trusted for a rig: always measured, so never a fact of a file."""
NEEDED = {
    "camera": (
        *("width_px", "height_px", "frame_rates_hz", "pixel_formats", "bit_depth", "exposure_range_s"),
        *("shutter", "chroma", "hfov_deg"),
    ),
    "projector": (
        *("width_px", "height_px", "refresh_rates_hz", "light_source", "throw_ratio"),
        *("brightness_lm", "pjlink_class", "latency_s"),
    ),
}
"""What a reader looks for: each is a fact, or it is named as to be measured."""

Value = TypeVar("Value")
Pixels = Annotated[int, Field(ge=1)]
Positive = Annotated[float, Field(gt=0)]
Angle = Annotated[float, Field(gt=0, lt=180)]
Text = Annotated[str, Field(min_length=1)]
UsbId = Annotated[str, Field(pattern=r"^[0-9a-f]{4}:[0-9a-f]{4}$")]
Mode = tuple[Pixels, Pixels, Positive]


class FactSource(Table):
    """A public document."""

    title: Text
    address: Annotated[str, Field(pattern=r"^https?://\S+$")]


class Fact(Table, Generic[Value]):
    """A value, the key of the document that says it, and its words."""

    value: Value
    source: Text
    quote: Text
    note: str = ""
    """How the value follows from the words, when it does not stand in them."""


class CameraFacts(Table):
    """What is known of a camera model; every fact may be missing."""

    sensor: Fact[str] | None = None
    interface: Fact[str] | None = None
    usb_ids: Fact[tuple[UsbId, ...]] | None = None
    device_names: Fact[tuple[Text, ...]] | None = None
    """How its V4L2 name begins: needed where several models share their USB ids."""
    width_px: Fact[Pixels] | None = None
    height_px: Fact[Pixels] | None = None
    frame_rates_hz: Fact[tuple[Positive, ...]] | None = None
    """At full resolution."""
    modes: Fact[tuple[Mode, ...]] | None = None
    """(width_px, height_px, highest frame_rate_hz) of other sizes too."""
    pixel_formats: Fact[tuple[Text, ...]] | None = None
    """Four characters each, as V4L2 calls them."""
    bit_depth: Fact[Annotated[int, Field(ge=8, le=16)]] | None = None
    shutter: Fact[Literal["global", "rolling"]] | None = None
    chroma: Fact[Literal["mono", "colour"]] | None = None
    exposure_range_s: Fact[tuple[Positive, Positive]] | None = None
    shortest_exposure_s: Fact[Positive] | None = None
    longest_exposure_s: Fact[Positive] | None = None
    hfov_deg: Fact[Angle] | None = None
    dfov_deg: Fact[Angle] | None = None
    fov_deg: Fact[Angle] | None = None
    """A field of view whose direction the document does not say."""
    pixel_size_mm: Fact[Positive] | None = None
    full_well_e: Fact[Positive] | None = None
    read_noise_e: Fact[Positive] | None = None
    controls: Fact[tuple[Text, ...]] | None = None


class ProjectorFacts(Table):
    """What is known of a projector model; every fact may be missing."""

    imaging: Fact[Literal["DLP, one chip", "3LCD", "LCoS"]] | None = None
    light_source: Fact[Literal["lamp", "LED", "laser", "laser and LED"]] | None = None
    width_px: Fact[Pixels] | None = None
    height_px: Fact[Pixels] | None = None
    pixel_layout: Fact[Literal["rows", "diamond"]] | None = None
    """On a diamond layout single pixels of the input are not single mirrors."""
    refresh_rates_hz: Fact[tuple[Positive, ...]] | None = None
    """That it takes in its native resolution."""
    throw_ratio: Fact[tuple[Positive, Positive]] | None = None
    """Distance over picture width, shortest and longest zoom."""
    throw_example_m: Fact[tuple[Positive, Positive]] | None = None
    """A distance, and the picture's width at it."""
    ultra_short_throw: Fact[bool] | None = None
    vertical_offset_percent: Fact[float] | None = None
    brightness_lm: Fact[Positive] | None = None
    """As the maker claims."""
    measured_white_lm: Fact[Positive] | None = None
    measured_colour_lm: Fact[Positive] | None = None
    """Red, green and blue together; less than white where a clear segment or a boost adds white light."""
    contrast: Fact[Positive] | None = None
    """As the maker claims."""
    measured_contrast: Fact[Positive] | None = None
    colour_wheel: Fact[bool] | None = None
    colour_wheel_segments: Fact[Annotated[int, Field(ge=2)]] | None = None
    colour_wheel_speed: Fact[Positive] | None = None
    """Turns a frame."""
    clear_segment: Fact[bool] | None = None
    input_lag_s: Fact[Positive] | None = None
    """As somebody measured it."""
    pjlink_class: Fact[Literal[0, 1, 2]] | None = None
    """0: has no PJLink."""
    usb_ids: Fact[tuple[UsbId, ...]] | None = None


class _File(Table):
    schema_: Annotated[Literal[1], Field(alias="schema")]
    maker: Text
    model: Text
    to_be_measured: tuple[Text, ...] = ()
    """Keys that nobody could be cited for: `rig check`, `rig devices` or a tape find them."""
    sources: dict[str, FactSource]


class CameraFile(_File):
    """A file of ``hw_profiles/cameras``."""

    kind: Literal["camera"]
    facts: CameraFacts

    def fits(self, usb_id: str | None, name: str) -> bool:
        """Whether a device with these USB ids (``vvvv:pppp``) and this V4L2 name is of this model."""
        ids, names = self.facts.usb_ids, self.facts.device_names
        if ids is None or usb_id not in ids.value:
            return False
        return names is None or name.lower().startswith(tuple(one.lower() for one in names.value))


class ProjectorFile(_File):
    """A file of ``hw_profiles/projectors``."""

    kind: Literal["projector"]
    facts: ProjectorFacts


HardwareFile = CameraFile | ProjectorFile


def kind_of(raw: bytes, path: Path) -> str | None:
    """``camera`` or ``projector`` for a file of facts, None for any other. Raises ProfileError for what is no TOML."""
    kind = parse_toml(raw, path).get("kind")
    return kind if kind in KINDS else None


def parse_facts(raw: bytes, path: Path) -> HardwareFile:
    """Validate a file of facts; raises ProfileError with a line for each problem."""
    if kind_of(raw, path) == "projector":
        return read_model(ProjectorFile, raw, path, _cross_checks)
    return read_model(CameraFile, raw, path, _cross_checks)


def _cross_checks(data: dict[str, Any]) -> list[str]:
    """Facts whose source is not listed, sources that nothing uses, gaps and contradictions of ``to_be_measured``."""
    facts, sources = _table(data, "facts"), _table(data, "sources")
    named = {key: fact["source"] for key, fact in facts.items() if isinstance(fact, dict) and "source" in fact}
    listed = [key for key in data.get("to_be_measured", []) if isinstance(key, str)]
    kind = data.get("kind")
    problems = [
        f"facts.{key}.source: {source!r} is not in [sources]" for key, source in named.items() if source not in sources
    ]
    problems += [f"sources.{key}: no fact names it; remove it" for key in sources if key not in named.values()]
    problems += [f"to_be_measured: {key} is a fact already" for key in listed if key in facts]
    if kind not in KINDS:
        return [*problems, f"kind: is {kind!r}, should be one of {', '.join(KINDS)}"] if "kind" in data else problems
    known = {*(CameraFacts if kind == "camera" else ProjectorFacts).model_fields, *MEASURED_ONLY[kind]}
    problems += [f"to_be_measured: {key} is no key of a {kind}" for key in listed if key not in known]
    problems += [
        f"facts.{key}: missing; cite it, or name it in to_be_measured"
        for key in NEEDED[kind]
        if key not in facts and key not in listed
    ]
    return problems


def _table(data: dict[str, Any], key: str) -> dict[str, Any]:
    table = data.get(key)
    return table if isinstance(table, dict) else {}


def load_facts(path: Path) -> HardwareFile:
    """Read and validate one file; raises ProfileError."""
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise ProfileError(f"{path}: cannot be read: {error.strerror}; check the name and its permissions") from error
    return parse_facts(raw, path)


def known_cameras(folder: Path = FOLDER) -> list[CameraFile]:
    """Every camera model that there are facts of. Raises ProfileError."""
    return [one for one in _load_all(folder / "cameras") if isinstance(one, CameraFile)]


def known_projectors(folder: Path = FOLDER) -> list[ProjectorFile]:
    """Every projector model that there are facts of. Raises ProfileError."""
    return [one for one in _load_all(folder / "projectors") if isinstance(one, ProjectorFile)]


def _load_all(folder: Path) -> list[HardwareFile]:
    return [load_facts(path) for path in sorted(folder.glob("*.toml"))]


FileOf = TypeVar("FileOf", CameraFile, ProjectorFile)


def by_model(name: str, files: list[FileOf]) -> FileOf:
    """The one file whose maker and model contain a name, however it is spelled.

    Raises ProfileError, with the list, when there is none or more than one.
    """
    wanted = _letters(name)
    exact = [one for one in files if wanted in (_letters(one.model), _letters(one.maker + one.model))]
    found = exact or [one for one in files if wanted and wanted in _letters(one.maker + one.model)]
    if len(found) == 1:
        return found[0]
    listed = ", ".join(f"{one.maker} {one.model}" for one in (found or files))
    what = "fits several models" if found else "no facts are known of this model"
    raise ProfileError(f"{name!r}: {what}; give one of {listed}")


def _letters(text: str) -> str:
    return re.sub(r"[^a-z0-9]", "", text.lower())
