"""The tables of a profile, each a frozen record: cameras, projectors, lengths, the surface, what is captured."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, Field, JsonValue, model_validator

from calibration.radiometry.mosaic import MosaicPattern
from rig.devices.plausible import Electrons, MetresOfPatch, SecondsOfDelay, SecondsOfWaiting, plausible
from rig.devices.protocols import ExposureRange
from rig.files.toml import Table

Byte = Annotated[int, Field(ge=0, le=255)]
Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Share = Annotated[float, Field(gt=0, le=1)]
Count = Annotated[int, Field(ge=1)]
FewCount = Annotated[int, Field(ge=1, le=1000)]
"""Of frames: more of one kind than a session can mean."""
FieldOfView = Annotated[float, Field(gt=0, lt=180)]
Pixel = tuple[float, float]
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$", max_length=40)]
"""Fit for a file's name."""


MOST_PATCHES = 15_000
"""Of a room: the light between them then takes 1.8 GB, in three bands three times that."""
MOST_PX = 128 << 20
"""Of a device: one frame of more, in numbers, fills a gigabyte, and a session takes hundreds."""

MetresByTape = Annotated[float, Field(gt=0), plausible(0.01, 30, "metres, not centimetres or millimetres?")]
MetresOfWall = Annotated[float, Field(gt=0), plausible(0.05, 200, "metres, not centimetres or millimetres?")]
DegreesAskew = Annotated[float, Field(ge=0, le=2)]
DegreesOfView = Annotated[float, Field(gt=0, lt=180), plausible(2, 175, "degrees, not radians?")]
SecondsOfExposure = Annotated[float, Field(gt=0), plausible(1e-6, 600, "seconds, not milliseconds or microseconds?")]
Multiple = Annotated[float, Field(gt=0), plausible(1e-3, 1000, "times camera.exposure_s, not seconds?")]
Hertz = Annotated[float, Field(gt=0), plausible(0.1, 2000, "hertz, not seconds a frame or kilohertz?")]


def _possible(given: ExposureRange) -> ExposureRange:
    if given.shortest_s <= 0:
        raise ValueError(f"is {given}, should begin above 0 seconds")
    if given.shortest_s > given.longest_s:
        raise ValueError(f"{given} is no range; give the smaller number first")
    if given.shortest_s < 1e-7 or given.longest_s > 600:
        raise ValueError(f"is {given}, plausible are 1e-07 ... 600: seconds, not milliseconds or microseconds?")
    return given


def _check_size(width_px: int, height_px: int) -> None:
    """Raise ValueError for a size of which no frame fits in memory."""
    if width_px * height_px > MOST_PX:
        raise ValueError(
            f"{width_px} x {height_px} px is {width_px * height_px / 1e6:.4g} megapixels, the limit is "
            f"{MOST_PX >> 20}: no frame of it fits in memory; correct width_px and height_px"
        )


def check_patches(size_m: tuple[float, float, float], patch_size_m: float, key: str) -> None:
    """Raise ValueError for a room in so many patches that the light between all of them fits in no memory."""
    x, y, z = size_m
    patches = 2 * (x * y + y * z + z * x) / patch_size_m**2
    if patches > MOST_PATCHES:
        raise ValueError(
            f"{key} {patch_size_m:g} m makes {patches:.3g} patches of a room of {x:g} x {y:g} x {z:g} m, the limit is "
            f"{MOST_PATCHES}: the light between them would take {8e-9 * patches**2:.3g} GB; give larger patches"
        )


class CaptureTiming(Table):
    """How long to wait for a frame, and how often to ask again."""

    timeout_s: Annotated[SecondsOfWaiting, Field(gt=0)] = 5.0
    retries: Annotated[int, Field(ge=0, le=1000)] = 8
    replug_timeout_s: SecondsOfWaiting = 20.0
    """How long a device that went away is waited for."""


class CameraProfile(Table):
    """What the data sheet says of one camera."""

    name: Name
    """Unique among the rig's cameras and projectors."""
    driver: str
    """One of this program's (v4l2, simulated, replay), or of a package that offers others."""
    device_id: str | None = None
    """Which camera (v4l2): ``usb-VENDOR:PRODUCT-SERIAL``, or the bus path, as `rig devices` prints it."""
    pixel_format: str | None = None
    """Four characters (v4l2): GREY, Y10, Y12, Y16, YUYV, MJPG, BA81 ..."""
    controls: dict[str, int] = Field(default_factory=dict)
    """V4L2 controls by name, set after everything automatic is off."""
    options: dict[str, JsonValue] = Field(default_factory=dict)
    """Whatever else a driver of another package wants to know."""
    width_px: Count
    height_px: Count
    channels: Literal[1, 3] = 1
    mosaic: MosaicPattern | None = None
    """Colour filters of a sensor with one number a pixel (``channels = 3``): first two pixels of the first row, then
    of the second."""
    bit_depth: Annotated[int, Field(ge=8, le=16)]
    frame_rate_hz: Hertz
    exposure_range_s: Annotated[ExposureRange, AfterValidator(_possible)]
    exposure_s: SecondsOfExposure
    """Where the search for the reference exposure starts."""
    hfov_deg: DegreesOfView
    """Nominal horizontal field of view; calibration finds the real one."""
    lens: str | None = None
    """Lens file of `rig lenses`, relative to the profile: a prior of the geometry with all its covariance."""
    full_well_e: Annotated[Electrons, Field(gt=0)] | None = None
    read_noise_e: Electrons | None = None

    @property
    def full_scale_dn(self) -> int:
        """The largest digital number."""
        return int(2**self.bit_depth - 1)

    @property
    def shape(self) -> tuple[int, int, int]:
        """(height, width, numbers a pixel) of its frames."""
        return self.height_px, self.width_px, 1 if self.mosaic else self.channels

    @model_validator(mode="after")
    def _fits_in_memory(self) -> CameraProfile:
        _check_size(self.width_px, self.height_px)
        return self

    @model_validator(mode="after")
    def _has_colours(self) -> CameraProfile:
        if self.mosaic is not None and self.channels != 3:
            raise ValueError(f"mosaic {self.mosaic} makes three channels, not {self.channels}; write channels = 3")
        return self

    @model_validator(mode="after")
    def _starts_inside_its_range(self) -> CameraProfile:
        if not self.exposure_range_s.holds(self.exposure_s):
            raise ValueError(f"exposure_s {self.exposure_s:g} is outside exposure_range_s {self.exposure_range_s}")
        return self


class PjlinkTable(Table):
    """The projector's own network control."""

    host: str
    port: Annotated[int, Field(ge=1, le=65535)] = 4352
    password_variable: str | None = None
    """Environment variable that holds the password; a profile holds no secrets."""
    input: Annotated[str, Field(pattern=r"^[1-6][1-9A-Z]$")] | None = None
    """PJLink's input code, e.g. "31" for the first digital input."""
    warm_up_timeout_s: Annotated[SecondsOfWaiting, Field(gt=0)] = 120.0


class LightCrafterTable(Table):
    """A DLP LightCrafter 4500's USB control; never seen on real hardware by us."""

    serial: str | None = None
    led_currents: tuple[Byte, Byte, Byte] | None = None
    """Red, green, blue, in the controller's steps: 0 is off, larger is brighter, 104, 135, 130 after power-on."""


class ProjectorProfile(Table):
    """What the data sheet says of one projector, and its measured latency."""

    name: Name
    """Unique among the rig's cameras and projectors."""
    driver: str
    """One of this program's (kms, window, simulated, replay), or of a package that offers others."""
    output: str | None = None
    """Which output (kms, window): connector (``HDMI-A-1``) or ``edid:MAKER-MODEL-SERIAL``, as `rig devices` prints."""
    options: dict[str, JsonValue] = Field(default_factory=dict)
    """Whatever else a driver of another package wants to know."""
    width_px: Count
    height_px: Count
    bit_depth: Literal[8] = 8
    refresh_rate_hz: Hertz
    latency_s: SecondsOfDelay
    """From the display's time stamp to settled light, as `rig check` measured it."""
    hfov_deg: DegreesOfView
    lens: str | None = None
    """Lens file of `rig lenses`, relative to the profile: a prior of the geometry with all its covariance."""
    pjlink: PjlinkTable | None = None
    lightcrafter: LightCrafterTable | None = None

    @property
    def shape(self) -> tuple[int, int]:
        """(height, width)."""
        return self.height_px, self.width_px

    @model_validator(mode="after")
    def _fits_in_memory(self) -> ProjectorProfile:
        _check_size(self.width_px, self.height_px)
        return self


class Scale(Table):
    """A length that is measured by tape, and what it joins; without one a reconstruction has no metres."""

    between: tuple[Name, Name] | None = None
    """Names of two devices ..."""
    baseline_m: MetresByTape | None = None
    """... and the distance between their centres of projection."""
    projector: Name | None = None
    """Name of the projector that lights ..."""
    spots_px: tuple[Pixel, Pixel] | None = None
    """... two of its pixels (x, y) ..."""
    distance_m: MetresByTape | None = None
    """... and the distance between the spots."""

    @model_validator(mode="after")
    def _has_one_length(self) -> Scale:
        if (self.spots_px is None) != (self.distance_m is None):
            raise ValueError("spots_px and distance_m belong together; give both")
        if (self.baseline_m is None) == (self.spots_px is None):
            raise ValueError("needs either baseline_m, or spots_px and distance_m; measure one by tape")
        if (self.baseline_m is None) != (self.between is None):
            raise ValueError(
                'baseline_m and between = ["camera\'s name", "projector\'s name"] belong together; give both'
            )
        if (self.spots_px is None) != (self.projector is None):
            raise ValueError("spots_px and projector, the name of what lights them, belong together; give both")
        return self

    @property
    def names(self) -> tuple[str, ...]:
        """The devices that it joins, by name."""
        return self.between or (() if self.projector is None else (self.projector,))


class Room(Table):
    """What surfaces stand in: a room, or a corner of one, with flat faces along three directions."""

    closed: bool
    """Six faces; else only those that were seen."""
    size_m: tuple[MetresOfWall, MetresOfWall, MetresOfWall] | None = None
    """Inner size by tape, true to 0.3 %: places walls that nobody sees, and holds those that are both seen."""
    lens_height_m: MetresOfWall | None = None
    """Of the projector's lens above the floor, by tape, true to 0.3 %: places an unseen floor, holds a seen one."""
    patch_size_m: MetresOfPatch = 0.3
    right_angles: bool = True
    askew_deg: DegreesAskew = 0.0
    """By which walls at right angles stand off square, one standard deviation; 0: by nothing. Houses: 0.3."""

    @model_validator(mode="after")
    def _is_possible(self) -> Room:
        if self.askew_deg and not self.right_angles:
            raise ValueError(
                f"askew_deg = {self.askew_deg:g} says how far right angles are off, right_angles = false that there "
                "are none: leave out one of them"
            )
        if self.size_m is not None:
            check_patches(self.size_m, self.patch_size_m, "patch_size_m")
        return self


class Box(Room):
    """A room, or a corner of one, with nothing in it."""

    kind: Literal["box"]


class Planes(Table):
    """Any number of flat pieces, at any angle."""

    kind: Literal["planes"]
    patch_size_m: MetresOfPatch = 0.3
    right_angles: bool = False
    """Nearly perpendicular pieces are exactly perpendicular."""


class FreeSurface(Room):
    """A room and whatever stands in it, as it is measured point by point."""

    kind: Literal["free"]
    size_to_walls: bool = False
    """`size_m` is between the walls themselves, not from what is seen through an opening in one: a niche, a door."""
    also: tuple[str, ...] = ()
    """Sessions of the same projector in the same place with the camera elsewhere, relative to the profile."""


class SurfaceFile(Room):
    """A room, and in it a mesh that is known beforehand: a CAD model, a scan."""

    kind: Literal["file"]
    file: str
    """Path of the mesh (OBJ, PLY, STL, glTF, GLB), relative to the profile."""
    unit: Literal["m", "cm", "mm", "in", "ft"] = "m"
    up: Literal["x", "y", "z", "-x", "-y", "-z"] | None = None
    """The file's axis that points up in the room; without: y of glTF, z of all others."""


Surface = Annotated[Box | Planes | FreeSurface | SurfaceFile, Field(discriminator="kind")]
"""What is projected on."""


class Viewer(Table):
    """Who judges the picture."""

    camera: Name | None = None
    """Name of the camera ..."""
    point_m: tuple[float, float, float] | None = None
    """... or a point, metres, in the frame of the first camera."""

    @model_validator(mode="after")
    def _is_one(self) -> Viewer:
        if (self.camera is None) == (self.point_m is None):
            raise ValueError("needs exactly one of camera (a name) and point_m (three numbers)")
        return self


class Patterns(Table):
    """How much is captured."""

    code: str = "long-run"
    """Structured-light code: ``gray``, ``long-run``, or that of another package."""
    checker_size_px: Count = 8
    checker_shifts: FewCount = 25
    response_levels: Annotated[int, Field(ge=3, le=256)] = 17
    exposures: Annotated[tuple[Multiple, ...], Field(min_length=1, max_length=16)] = (1.0, 8.0)
    """Multiples of the reference exposure that are merged."""
    frames_averaged: FewCount = 1


class TransportPhotographs(Table):
    """Photographs of known pictures that teach the model of the room's light."""

    photographs: Annotated[int, Field(ge=0, le=256)] = 0
    """At most; 0: the model alone."""


class Brightness(Table):
    """What a target's white means."""

    target_white_share: Share = 0.7
    """Level 255 of a target, as a share of the median camera value of projector white."""


class Limits(Table):
    """Where a verdict turns red; image errors in grey levels of 255."""

    geometry_rms_px: Positive = 0.5
    geometry_sigma_percent: Positive = 0.385
    valid_share: Share = 0.8
    comparison_rmse: Positive = 5.0
    comparison_bias: Positive = 2.0


class Replay(Table):
    """Which recording stands in for the devices."""

    session: str | None = None
    manifest: str | None = None

    @model_validator(mode="after")
    def _names_one_recording(self) -> Replay:
        if (self.session is None) == (self.manifest is None):
            raise ValueError("needs exactly one of session (a folder) and manifest (a TOML file)")
        return self
