"""A profile as text, each number with a word of where it comes from."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from calibration.geometry.planes import USUAL_ASKEW_DEG
from rig.devices.genicam.formats import PIXEL_FORMATS as GENICAM_FORMATS
from rig.devices.protocols import ExposureRange
from rig.devices.v4l2.controls import exposure_range_of
from rig.devices.v4l2.formats import PIXEL_FORMATS
from rig.files.toml import toml_value
from rig.inventory.choose import MOST_RATE_HZ, CameraMode, fixed_controls
from rig.inventory.found import ShownMode
from rig.profile.apply import GUESS as MEASURE
from rig.profile.hardware_facts import CameraFacts, Fact, ProjectorFacts, Value
from rig.profile.schema import SCHEMA

if TYPE_CHECKING:
    from rig.devices.genicam.describe import GenicamAbilities
    from rig.devices.genicam.find import FoundGenicam
    from rig.devices.gphoto2.find import FoundStill, StillAbilities
    from rig.devices.v4l2.describe import ControlAbility
    from rig.devices.v4l2.find import FoundCamera

CAMERA, PROJECTOR = "camera", "projector"
"""Names that the only devices get."""
DEVICE = "device"
_COMMENT_COLUMN = 44
_QUOTE_WIDTH = 60
_HEAD = """\
# Written by `rig profile new` from what was plugged in. Beside each number stands where it comes from:
#   device     what the driver or the display says
#   cited      public documents, named in hw_profiles/cameras and hw_profiles/projectors
#   chosen     by this program, because it is a sensible start
#   MEASURE    only a guess: replace it. docs/how-to/run-a-real-rig.md says how.
"""
_GUESSED_RATE_HZ = 30.0
_GUESSED_REFRESH_HZ = 60.0
_GUESSED_LATENCY_S = 0.1
_GUESSED_RANGE_S = (1e-4, 0.2)
_GUESSED_STILL_RANGE_S, _GUESSED_STILL_PX = (1 / 4000, 30.0), (6000, 4000)
_GUESSED_CAMERA_DEG = 60.0
_GUESSED_PROJECTOR_DEG = 40.0


class ProfileLine(NamedTuple):
    """A line of a profile."""

    key: str
    value: object
    origin: str


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedCamera:
    """A camera, and how it is going to be run."""

    found: FoundCamera
    mode: CameraMode
    controls: tuple[ControlAbility, ...]
    facts: CameraFacts
    facts_of: str
    """Maker and model of the facts; empty when none are known."""

    @property
    def device_id(self) -> str:
        """As the profile names it."""
        return self.found.device_id

    @property
    def name(self) -> str:
        """What the driver calls it."""
        return self.found.name


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedBusCamera:
    """A GigE or USB3 camera, and what it said of itself."""

    found: FoundGenicam
    able: GenicamAbilities
    facts: CameraFacts
    facts_of: str
    """Maker and model of the facts; empty when none are known."""

    @property
    def device_id(self) -> str:
        """As the profile names it."""
        return self.found.device_id

    @property
    def name(self) -> str:
        """Maker and model."""
        return f"{self.found.vendor} {self.found.model}"


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedStill:
    """A still camera, and what it said of itself."""

    found: FoundStill
    able: StillAbilities
    facts: CameraFacts
    facts_of: str
    """Maker and model of the facts; empty when none are known."""

    @property
    def device_id(self) -> str:
        """As the profile names it: a serial number stays, a port does not."""
        return self.able.serial or self.found.port

    @property
    def name(self) -> str:
        """What the library calls it."""
        return self.found.model


AnyPlannedCamera = PlannedCamera | PlannedBusCamera | PlannedStill


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedDisplay:
    """A display, and the mode it is going to show."""

    driver: str
    output: str
    mode: ShownMode
    facts: ProjectorFacts
    facts_of: str


def profile_text(name: str, camera: AnyPlannedCamera, display: PlannedDisplay) -> str:
    """The whole file."""
    if isinstance(camera, PlannedCamera):
        controls, lines = fixed_controls(camera.controls), _camera_entries(camera, display)
    elif isinstance(camera, PlannedStill):
        controls, lines = {}, _still_entries(camera, display)
    else:
        controls, lines = {}, _bus_camera_entries(camera, display)
    parts = [
        _HEAD,
        _section("", [ProfileLine("schema", SCHEMA, ""), ProfileLine("name", name, ""), _description(camera, display)]),
        _section("[camera]", lines),
        _section(
            "camera.controls", [ProfileLine(key, value, f"chosen: {why}") for key, (value, why) in controls.items()]
        ),
        _section("[projector]", _projector_entries(display)),
        _section("[scale]", _scale_entries()),
        _section("surface", _surface_entries()),
    ]
    return "\n".join(part for part in parts if part)


def _description(camera: AnyPlannedCamera, display: PlannedDisplay) -> ProfileLine:
    words = f"{camera.facts_of or camera.name} with {display.facts_of or display.output}"
    return ProfileLine("description", words, "")


def _section(table: str, entries: Iterable[ProfileLine]) -> str:
    lines = [_line(entry) for entry in entries]
    return "\n".join([*([f"[{table}]"] if table else []), *lines, ""]) if lines else ""


def _line(entry: ProfileLine) -> str:
    text = f"{entry.key} = {toml_value(entry.value)}"
    origin = " ".join(word for word in entry.origin.split() if word.isprintable())
    return f"{text:<{_COMMENT_COLUMN}}  # {origin}" if origin else text


def _scale_entries() -> list[ProfileLine]:
    return [
        ProfileLine("between", (CAMERA, PROJECTOR), "chosen: the names of above"),
        ProfileLine("baseline_m", 0.5, f"{MEASURE}: lens to lens, or better two spots, by tape"),
    ]


def _surface_entries() -> list[ProfileLine]:
    return [
        ProfileLine("kind", "box", "chosen: a room, or a corner of one"),
        ProfileLine("closed", False, f"{MEASURE}: true if light comes back from all sides"),
        ProfileLine("askew_deg", USUAL_ASKEW_DEG, "chosen: as walls of usual houses stand; 0: exactly square"),
        ProfileLine("# size_m", (4.0, 5.0, 2.5), "if you measure the room by tape (x ends at the wall on the right)"),
        ProfileLine("# lens_height_m", 1.2, "if you measure the projector's lens above the floor"),
    ]


def _camera_entries(camera: PlannedCamera, display: PlannedDisplay) -> list[ProfileLine]:
    mode, facts = camera.mode, camera.facts
    range_s, range_origin = _exposure_range(camera)
    start_s = min(max(1 / (_refresh_hz(display)[0]), range_s[0]), range_s[1])
    rate = ProfileLine("frame_rate_hz", mode.frame_rate_hz, DEVICE)
    if mode.frame_rate_hz is None:
        rate = ProfileLine("frame_rate_hz", _GUESSED_RATE_HZ, f"{MEASURE}: the driver names none")
    entries = [
        ProfileLine("name", CAMERA, ""),
        ProfileLine("driver", "v4l2", ""),
        ProfileLine("device_id", camera.found.device_id, f"{DEVICE}: {camera.found.name}"),
        ProfileLine("pixel_format", mode.pixel_format, f"{DEVICE}; chosen: the rawest that a rig can use"),
        ProfileLine("width_px", mode.width_px, DEVICE),
        ProfileLine("height_px", mode.height_px, DEVICE),
        ProfileLine("bit_depth", mode.bit_depth, _bit_depth_origin(camera)),
        rate,
        ProfileLine("exposure_range_s", range_s, range_origin),
        ProfileLine(
            "exposure_s", round(start_s, 7), "chosen: one whole picture of the projector, where the search begins"
        ),
        _camera_angle(facts, camera.facts_of, (mode.width_px, mode.height_px)),
    ]
    for key in ("full_well_e", "read_noise_e"):
        fact = getattr(facts, key)
        if fact is not None:
            entries.append(ProfileLine(key, fact.value, _cited(camera.facts_of, fact)))
    return entries


def _bus_camera_entries(camera: PlannedBusCamera, display: PlannedDisplay) -> list[ProfileLine]:
    able, name = camera.able, camera.able.pixel_formats[0]
    known = GENICAM_FORMATS[name]
    range_s = able.exposure_range_s or _GUESSED_RANGE_S
    start_s = min(max(1 / _refresh_hz(display)[0], range_s[0]), range_s[1])
    rate_hz = min(able.frame_rate_hz or _GUESSED_RATE_HZ, MOST_RATE_HZ)
    colours = [ProfileLine("channels", 3, f"{DEVICE}: of {name}")] if known.mosaic or known.numbers == 3 else []
    mosaic = [ProfileLine("mosaic", known.mosaic, f"{DEVICE}: of {name}")] if known.mosaic else []
    depth = f"{MEASURE}: many cameras fill fewer of 16 bits" if known.depth == 16 else f"{DEVICE}: of {name}"
    return [
        ProfileLine("name", CAMERA, ""),
        ProfileLine("driver", "genicam", ""),
        ProfileLine("device_id", camera.found.device_id, f"{DEVICE}: {camera.name} at {camera.found.address}"),
        ProfileLine("pixel_format", name, f"{DEVICE}; chosen: the rawest that a rig can use"),
        ProfileLine("width_px", able.width_px, DEVICE),
        ProfileLine("height_px", able.height_px, DEVICE),
        *colours,
        *mosaic,
        ProfileLine("bit_depth", known.depth, depth),
        ProfileLine(
            "frame_rate_hz", round(rate_hz, 3), DEVICE if able.frame_rate_hz else f"{MEASURE}: it does not say"
        ),
        ProfileLine("exposure_range_s", range_s, DEVICE if able.exposure_range_s else f"{MEASURE}: it does not say"),
        ProfileLine(
            "exposure_s", round(start_s, 7), "chosen: one whole picture of the projector, where the search begins"
        ),
        _camera_angle(camera.facts, camera.facts_of, (able.width_px, able.height_px)),
    ]


def _still_entries(camera: PlannedStill, display: PlannedDisplay) -> list[ProfileLine]:
    """Size and filters are guesses: only a picture tells them, and the first one that is of others says which."""
    facts, range_s, origin = camera.facts, camera.able.exposure_range_s, f"{DEVICE}: its steps"
    if range_s is None:
        range_s, origin = ExposureRange(*_GUESSED_STILL_RANGE_S), f"{MEASURE}: turn the dial to M, then it says"
    width, height = (
        ProfileLine(key, guess if fact is None else fact.value, _size_or_guess(fact, camera.facts_of))
        for key, guess, fact in zip(
            ("width_px", "height_px"), _GUESSED_STILL_PX, (facts.width_px, facts.height_px), strict=True
        )
    )
    form = [
        ProfileLine("pixel_format", "RAW", f"{DEVICE}; chosen: linear, and as the sensor gave it"),
        ProfileLine("mosaic", "RGGB", f"{MEASURE}: the first picture says"),
        ProfileLine("channels", 3, "chosen: of its filters"),
        ProfileLine("bit_depth", 14, f"{MEASURE}: of its raw files; white is scaled to it"),
    ]
    if not camera.able.has_raw:
        form = [
            ProfileLine("pixel_format", "JPEG", f"{DEVICE}: it offers no raw files"),
            ProfileLine("channels", 3, "chosen"),
            ProfileLine("bit_depth", 8, "chosen: of JPEG"),
        ]
    return [
        ProfileLine("name", CAMERA, ""),
        ProfileLine("driver", "gphoto2", ""),
        ProfileLine("device_id", camera.device_id, f"{DEVICE}: {camera.name} at {camera.found.port}"),
        *form,
        width,
        height,
        ProfileLine("frame_rate_hz", 1.0, "chosen: it is asked for each picture"),
        ProfileLine("exposure_range_s", range_s, origin),
        ProfileLine(
            "exposure_s", range_s.nearest_s(1 / _refresh_hz(display)[0]), "chosen: where the search begins, a step"
        ),
        _camera_angle(facts, camera.facts_of, (int(str(width.value)), int(str(height.value)))),
    ]


def _size_or_guess(fact: Fact[int] | None, model: str) -> str:
    return f"{MEASURE}: of its largest pictures" if fact is None else _cited(model, fact)


def _cited(model: str, fact: Fact[Value]) -> str:
    words = textwrap.shorten(fact.quote, _QUOTE_WIDTH, placeholder=" …")
    return f"cited: {model}, “{words}”"


def _bit_depth_origin(camera: PlannedCamera) -> str:
    if PIXEL_FORMATS[camera.mode.pixel_format].bits < 16:
        return f"{DEVICE}: of {camera.mode.pixel_format}"
    if camera.facts.bit_depth is not None:
        return _cited(camera.facts_of, camera.facts.bit_depth)
    return f"{MEASURE}: there is room for 16 bits, many cameras fill fewer; see where white saturates"


def _exposure_range(camera: PlannedCamera) -> tuple[tuple[float, float], str]:
    asked = exposure_range_of(camera.controls)
    if asked is not None:
        period_s = 1 / (camera.mode.frame_rate_hz or _GUESSED_RATE_HZ)
        too_long = asked[1] > period_s
        return asked, f"{DEVICE}; many cameras stop at a frame's {period_s:.3g} s" if too_long else DEVICE
    fact = camera.facts.exposure_range_s
    if fact is not None:
        return fact.value, _cited(camera.facts_of, fact)
    return _GUESSED_RANGE_S, f"{MEASURE}: the camera has no control of its exposure time"


def _camera_angle(facts: CameraFacts, facts_of: str, size_px: tuple[int, int]) -> ProfileLine:
    if facts.hfov_deg is not None:
        return ProfileLine("hfov_deg", facts.hfov_deg.value, _cited(facts_of, facts.hfov_deg))
    if facts.dfov_deg is not None:
        share = size_px[0] / math.hypot(*size_px)
        wide = 2 * math.degrees(math.atan(share * math.tan(math.radians(facts.dfov_deg.value / 2))))
        return ProfileLine("hfov_deg", round(wide, 1), f"{MEASURE}: {_cited(facts_of, facts.dfov_deg)}")
    return ProfileLine("hfov_deg", _GUESSED_CAMERA_DEG, f"{MEASURE}: 2 atan(width seen / (2 distance))")


def _projector_entries(display: PlannedDisplay) -> list[ProfileLine]:
    refresh_hz, refresh_origin = _refresh_hz(display)
    return [
        ProfileLine("name", PROJECTOR, ""),
        ProfileLine("driver", display.driver, ""),
        ProfileLine("output", display.output, DEVICE),
        ProfileLine("width_px", display.mode.width_px, _size_origin(display)),
        ProfileLine("height_px", display.mode.height_px, _size_origin(display)),
        ProfileLine("refresh_rate_hz", refresh_hz, refresh_origin),
        ProfileLine("latency_s", _GUESSED_LATENCY_S, f"{MEASURE}: `rig check` suggests it"),
        _projector_angle(display),
    ]


def _size_origin(display: PlannedDisplay) -> str:
    facts, mode = display.facts, display.mode
    if facts.width_px is None or facts.height_px is None:
        return f"{DEVICE}; is it the projector's own resolution?"
    own = (facts.width_px.value, facts.height_px.value)
    if own == (mode.width_px, mode.height_px):
        return f"{DEVICE}; cited: the own resolution of {display.facts_of}"
    return f"{MEASURE}: {display.facts_of} has {own[0]} x {own[1]}, which this output does not offer"


def _refresh_hz(display: PlannedDisplay) -> tuple[float, str]:
    if display.mode.refresh_rate_hz:
        return round(display.mode.refresh_rate_hz, 6), DEVICE
    return _GUESSED_REFRESH_HZ, f"{MEASURE}: it could not be asked"


def _projector_angle(display: PlannedDisplay) -> ProfileLine:
    facts = display.facts
    for fact in (facts.throw_example_m, facts.throw_ratio):
        if fact is None:
            continue
        distance, width = fact.value if fact is facts.throw_example_m else (sum(fact.value) / 2, 1.0)
        angle = 2 * math.degrees(math.atan(width / (2 * distance)))
        return ProfileLine("hfov_deg", round(angle, 1), f"{MEASURE}, zoom changes it: {_cited(display.facts_of, fact)}")
    return ProfileLine("hfov_deg", _GUESSED_PROJECTOR_DEG, f"{MEASURE}: 2 atan(picture's width / (2 distance))")
