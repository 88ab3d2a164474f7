"""Hardware profiles: one TOML file describes a rig; every mistake in it is reported at once, a line each."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, PrivateAttr, model_validator

from rig.devices.simulated.settings import SimulationSettings
from rig.errors import ProfileError
from rig.files.toml import parse_toml, validate

SCHEMA = 1
"""The newest profile schema that this version reads."""

CameraDriver = Literal["simulated", "replay", "v4l2"]
ProjectorDriver = Literal["simulated", "replay", "kms", "window"]
Byte = Annotated[int, Field(ge=0, le=255)]
Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Share = Annotated[float, Field(gt=0, le=1)]
Count = Annotated[int, Field(ge=1)]
FieldOfView = Annotated[float, Field(gt=0, lt=180)]
Pixel = tuple[float, float]


def _increasing(pair: tuple[float, float]) -> tuple[float, float]:
    if pair[0] > pair[1]:
        raise ValueError(f"{pair[0]:g} … {pair[1]:g} is no range; give the smaller number first")
    return pair


class _Table(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class CameraProfile(_Table):
    """What the data sheet says of the camera."""

    driver: CameraDriver
    device_id: str | None = None
    """Which camera (v4l2): ``usb-VENDOR:PRODUCT-SERIAL``, or the bus path, as `rig devices` prints it."""
    pixel_format: str | None = None
    """Four characters (v4l2): GREY, Y10, Y12, Y16, YUYV, MJPG, BA81 ..."""
    controls: dict[str, int] = Field(default_factory=dict)
    """V4L2 controls by name, set after everything automatic is off."""
    width_px: Count
    height_px: Count
    channels: Literal[1, 3] = 1
    bit_depth: Annotated[int, Field(ge=8, le=16)]
    frame_rate_hz: Positive
    exposure_range_s: Annotated[tuple[Positive, Positive], AfterValidator(_increasing)]
    exposure_s: Positive
    """Where the search for the reference exposure starts."""
    hfov_deg: FieldOfView
    """Nominal horizontal field of view; calibration finds the real one."""
    full_well_e: Positive | None = None
    read_noise_e: NotNegative | None = None

    @property
    def full_scale_dn(self) -> int:
        """The largest digital number."""
        return int(2**self.bit_depth - 1)

    @property
    def shape(self) -> tuple[int, int, int]:
        """(height, width, channels)."""
        return self.height_px, self.width_px, self.channels

    @model_validator(mode="after")
    def _starts_inside_its_range(self) -> CameraProfile:
        shortest, longest = self.exposure_range_s
        if not shortest <= self.exposure_s <= longest:
            raise ValueError(f"exposure_s {self.exposure_s:g} is outside exposure_range_s {shortest:g} … {longest:g}")
        return self


class ProjectorProfile(_Table):
    """What the data sheet says of the projector, and its measured latency."""

    driver: ProjectorDriver
    output: str | None = None
    """Which output (kms, window): connector (``HDMI-A-1``) or ``edid:MAKER-MODEL-SERIAL``, as `rig devices` prints."""
    width_px: Count
    height_px: Count
    bit_depth: Literal[8] = 8
    refresh_rate_hz: Positive
    latency_s: NotNegative
    """From the display's time stamp to settled light, as `rig check` measured it."""
    hfov_deg: FieldOfView

    @property
    def shape(self) -> tuple[int, int]:
        """(height, width)."""
        return self.height_px, self.width_px


class Timing(_Table):
    """How long to wait for a frame, and how often to ask again."""

    timeout_s: Positive = 5.0
    retries: Annotated[int, Field(ge=0)] = 8
    replug_timeout_s: NotNegative = 20.0
    """How long a device that went away is waited for."""


class Scale(_Table):
    """The one length that is measured by tape; without it a reconstruction has no metres."""

    baseline_m: Positive | None = None
    """Between the camera's and the projector's centres of projection."""
    spots_px: tuple[Pixel, Pixel] | None = None
    """Two projector pixels (x, y) ..."""
    distance_m: Positive | None = None
    """... and the distance between the spots that they light."""

    @model_validator(mode="after")
    def _has_one_length(self) -> Scale:
        if (self.spots_px is None) != (self.distance_m is None):
            raise ValueError("spots_px and distance_m belong together; give both")
        if (self.baseline_m is None) == (self.spots_px is None):
            raise ValueError("needs either baseline_m, or spots_px and distance_m; measure one by tape")
        return self


class Room(_Table):
    """What is known of the room."""

    closed: bool
    size_m: tuple[Positive, Positive, Positive] | None = None
    """Inner size by tape; places only walls that nobody sees."""
    patch_size_m: Positive = 0.3
    right_angles: bool = True


class Patterns(_Table):
    """How much is captured."""

    checker_size_px: Count = 8
    checker_shifts: Count = 25
    response_levels: Annotated[int, Field(ge=3, le=256)] = 17
    exposures: Annotated[tuple[Positive, ...], Field(min_length=1)] = (1.0, 8.0)
    """Multiples of the reference exposure that are merged."""
    frames_averaged: Count = 1


class Brightness(_Table):
    """What a target's white means."""

    target_white_share: Share = 0.7
    """Level 255 of a target, as a share of the median camera value of projector white."""


class Limits(_Table):
    """Where a verdict turns red; image errors in grey levels of 255."""

    geometry_rms_px: Positive = 0.5
    valid_share: Share = 0.8
    comparison_rmse: Positive = 5.0
    comparison_bias: Positive = 2.0


class Replay(_Table):
    """Which recording stands in for the devices."""

    session: str | None = None
    manifest: str | None = None

    @model_validator(mode="after")
    def _names_one_recording(self) -> Replay:
        if (self.session is None) == (self.manifest is None):
            raise ValueError("needs exactly one of session (a folder) and manifest (a TOML file)")
        return self


class Pjlink(_Table):
    """The projector's own network control."""

    host: str
    port: Annotated[int, Field(ge=1, le=65535)] = 4352
    password_variable: str | None = None
    """Environment variable that holds the password; a profile holds no secrets."""
    input: Annotated[str, Field(pattern=r"^[1-6][1-9A-Z]$")] | None = None
    """PJLink's input code, e.g. "31" for the first digital input."""
    warm_up_timeout_s: Positive = 120.0


class LightCrafter(_Table):
    """A DLP LightCrafter 4500's USB control; never seen on real hardware by us."""

    serial: str | None = None
    led_currents: tuple[Byte, Byte, Byte] | None = None
    """Red, green, blue, in the controller's steps: 0 is off, larger is brighter, 104, 135, 130 after power-on."""


class Profile(_Table):
    """A validated hardware profile; ``raw`` are the bytes it was read from."""

    schema_: Annotated[Literal[1], Field(alias="schema")]
    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$")]
    description: str = ""
    camera: CameraProfile
    projector: ProjectorProfile
    timing: Timing = Timing()
    scale: Scale
    room: Room
    patterns: Patterns = Patterns()
    brightness: Brightness = Brightness()
    limits: Limits = Limits()
    replay: Replay | None = None
    pjlink: Pjlink | None = None
    lightcrafter: LightCrafter | None = None
    simulation: SimulationSettings | None = None
    """The simulated truth; only the simulated pair, the virtual rig and the scoring of results may look at it."""

    _raw: bytes = PrivateAttr(default=b"")
    _path: Path = PrivateAttr(default=Path())

    @classmethod
    def parse(cls, raw: bytes, path: Path) -> Profile:
        """Validate a profile's bytes; ``path`` names it in messages and anchors relative paths.

        Raises ProfileError with a line for each problem.
        """
        data = parse_toml(raw, path)
        _refuse_newer(data, path)
        profile = validate(cls, data, path, _cross_checks)
        profile._raw, profile._path = raw, path.absolute()  # noqa: SLF001 - this class's own
        return profile

    @property
    def raw(self) -> bytes:
        """The exact bytes of the file."""
        return self._raw

    @property
    def sha256(self) -> str:
        """Hexadecimal hash of ``raw``."""
        return hashlib.sha256(self._raw).hexdigest()

    @property
    def path(self) -> Path:
        """Absolute path of the file it was read from."""
        return self._path

    @property
    def recording(self) -> Path:
        """Absolute path of the replayed session or manifest. Raises ProfileError when there is none."""
        named = self.replay and (self.replay.session or self.replay.manifest)
        if not named:
            raise ProfileError(f"{self._path}: replay: this profile replays nothing; use driver = 'replay'")
        return self._path.parent / named


def _refuse_newer(data: dict[str, Any], path: Path) -> None:
    schema = data.get("schema")
    if isinstance(schema, int) and schema > SCHEMA:
        raise ProfileError(
            f"{path}: schema: {schema} is newer than {SCHEMA}, the newest that this version reads; update procam-rig"
        )


PARTNERS = {"simulated": ("simulated",), "replay": ("replay",), "v4l2": ("kms", "window")}
"""Which projector drivers go with a camera's."""


def _cross_checks(data: dict[str, Any]) -> list[str]:
    """Problems between tables, looked for even when single keys are wrong."""
    tables = [data.get(name) for name in ("camera", "projector")]
    camera, projector = (table if isinstance(table, dict) else {} for table in tables)
    driver, partner = camera.get("driver"), projector.get("driver")
    problems = []
    if driver in PARTNERS and partner in get_args(ProjectorDriver) and partner not in PARTNERS[driver]:
        fitting = " or ".join(map(repr, PARTNERS[driver]))
        problems.append(f"projector.driver: {partner!r}, but the camera's is {driver!r}; it has to be {fitting}")
    for table, needed in (("simulation", "simulated"), ("replay", "replay")):
        if driver == needed and table not in data:
            problems.append(f"{table}: missing; driver = {needed!r} needs a [{table}] table")
    for table, allowed in (("simulation", ("simulated", "v4l2")), ("replay", ("replay",))):
        if driver in PARTNERS and driver not in allowed and table in data:
            which = " or ".join(map(repr, allowed))
            problems.append(f"{table}: only for driver = {which}, the camera's is {driver!r}; remove the table")
    return (
        problems
        + _device_keys("camera", camera, ("device_id", "pixel_format"), ("v4l2",))
        + _device_keys("projector", projector, ("output",), ("kms", "window"))
    )


def _device_keys(name: str, table: dict[str, Any], keys: tuple[str, ...], drivers: tuple[str, ...]) -> list[str]:
    """Keys that say which device: needed by drivers that have a choice, and by no other."""
    driver = table.get("driver")
    if driver in drivers:
        return [f"{name}.{key}: missing; `rig devices` prints it" for key in keys if key not in table]
    which = " or ".join(map(repr, drivers))
    return [f"{name}.{key}: only for driver = {which}; remove it" for key in keys if key in table and driver]


def load_profile(path_or_name: str | Path) -> Profile:
    """Read and validate a profile: a path, or the bare name of one in ``hw_profiles`` (``"sim-room"``).

    Raises ProfileError when it is not found, or with a line for each problem in it.
    """
    path = _find(path_or_name)
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise ProfileError(f"{path}: cannot be read: {error.strerror}; check the name and its permissions") from error
    return Profile.parse(raw, path)


def _find(path_or_name: str | Path) -> Path:
    given = Path(path_or_name)
    if given.is_file():
        return given
    folders = (Path("hw_profiles"), Path(__file__).parents[2] / "hw_profiles")
    if given.name == str(path_or_name):
        name = given.name.removesuffix(".toml") + ".toml"
        for folder in folders:
            if (folder / name).is_file():
                return folder / name
    known = sorted({file.stem for folder in folders for file in folder.glob("*.toml")})
    raise ProfileError(f"{path_or_name}: no such profile; give a file or one of {', '.join(known) or '(none)'}")


@dataclass(frozen=True, slots=True)
class CheckedProfile:
    """What `rig profile check` says of one file."""

    path: str
    problems: tuple[str, ...]
    summary: str
    """One line when there is no problem."""

    @property
    def ok(self) -> bool:
        """No problem was found."""
        return not self.problems


def check_profiles(paths: list[str]) -> list[CheckedProfile]:
    """Validate each file; a broken one does not hide the others."""
    return [_check(path) for path in paths]


def _check(path: str) -> CheckedProfile:
    try:
        profile = load_profile(path)
    except ProfileError as error:
        return CheckedProfile(path, tuple(str(error).splitlines()), "")
    camera, projector = profile.camera, profile.projector
    summary = (
        f"{path}: ok: {profile.name}, {camera.driver}, camera {camera.width_px} x {camera.height_px} px, "
        f"projector {projector.width_px} x {projector.height_px} px"
    )
    return CheckedProfile(path, (), summary)
