"""The `[simulation]` table of a simulated rig's profile: the truth that calibration has to find out.

Nothing outside the simulated devices and the scoring of its results may read these numbers.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, TypeVar

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from rig.devices.plausible import (
    Degrees,
    Electrons,
    HertzOfLight,
    MetresOfFocus,
    MetresOfLens,
    MetresOfPatch,
    MetresOfPlace,
    SecondsOfDelay,
    SecondsOfWarmUp,
)
from rig.files.toml import Table

Item = TypeVar("Item")
Vector3 = tuple[float, float, float]
Place = tuple[MetresOfPlace, MetresOfPlace, MetresOfPlace]
FaceName = Literal["floor", "ceiling", "x0", "x1", "y0", "y1"]
Share = Annotated[float, Field(ge=0.0, le=1.0)]
Reflectance = Annotated[float, Field(ge=0.0, lt=1.0)]
NotNegative = Annotated[float, Field(ge=0.0)]
FrameCount = Annotated[int, Field(ge=0)]
_NEXT_SEED = 1_000_003
"""From one device's seed to the next's; a prime, so that seeds of neighbouring profiles do not meet."""
BANDS = 3
"""Of a colour camera: red, green, blue."""


def _some(tables: tuple[Item, ...]) -> tuple[Item, ...]:
    if not tables:
        raise ValueError("is empty; give at least one table")
    return tables


AT_LEAST_ONE = AfterValidator(_some)
"""Of an array of tables; a length in the type would be missed, too, when a table is wrong."""


def _listed(value: Any) -> Any:
    if isinstance(value, list):
        return tuple(value)
    return (value,) if isinstance(value, int | float) else value


def _one_or_three(values: tuple[float, ...]) -> tuple[float, ...]:
    if len(values) not in (1, BANDS):
        raise ValueError(f"has {len(values)} numbers; give one, or {BANDS} for red, green and blue")
    return values


Colour = Annotated[tuple[Reflectance, ...], BeforeValidator(_listed), AfterValidator(_one_or_three)]
"""Reflectance: one number, or one each for red, green and blue."""
Gamma = Annotated[tuple[Annotated[float, Field(gt=0)], ...], BeforeValidator(_listed), AfterValidator(_one_or_three)]
MixingRow = tuple[NotNegative, NotNegative, NotNegative]


def in_band(values: tuple[float, ...], band: int | None) -> float:
    """Return what a band (0 red, 1 green, 2 blue) sees of one number or three; None: a grey camera, their mean."""
    if len(values) == 1:
        return values[0]
    return sum(values) / len(values) if band is None else values[band]


def _forward(interval: tuple[float, float]) -> tuple[float, float]:
    if interval[0] >= interval[1]:
        raise ValueError(f"{interval[0]:g} … {interval[1]:g} s does not end after its beginning; swap the two times")
    return interval


Interval = Annotated[tuple[float, float], AfterValidator(_forward)]
"""Begin and end on the rig's clock, seconds."""


class SimulatedLensSettings(Table):
    """Pose and lens of one device of the simulated world."""

    name: Annotated[str, Field(min_length=1)]
    """The camera's or projector's, as the profile calls it."""
    position_m: Place
    look_at_m: Place
    roll_deg: Degrees = 0.0
    turned_deg: tuple[Degrees, Degrees, Degrees] = (0.0, 0.0, 0.0)
    """By how much it was turned since, as a rotation vector about its own axes right, down and forward."""
    moved_m: Place = (0.0, 0.0, 0.0)
    """By how much its lens was shifted since, along the room's axes; it looks along where it did."""
    focal_px: Annotated[float, Field(gt=0)]
    principal_point_px: tuple[float, float]
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)
    """k1, k2, p1, p2, k3 in OpenCV's order."""
    vignetting: tuple[float, float] = (0.0, 0.0)
    """v2, v4: relative illumination 1 + v2 r² + v4 r⁴, r = distance from the axis / half diagonal."""
    blur_px: Annotated[float, Field(ge=0.0)] = 0.0
    """Standard deviation of the lens's Gaussian blur in the device's own pixels, on the axis."""
    corner_blur_px: Annotated[float, Field(ge=0.0)] | None = None
    """The same half a diagonal from the axis, with its square between; None: as on the axis."""
    halo: Annotated[float, Field(ge=0.0, le=0.2)] = 0.0
    """Share of its light that glass and dust scatter far around a bright place: veiling glare, a low ANSI contrast."""
    halo_px: Annotated[float, Field(gt=0.0)] = 12.0
    """Radius within which half of that lands, in the device's own pixels."""
    aperture_m: MetresOfLens = 0.0
    """Diameter of the lens's opening: what is not at `focus_m` is blurred; 0: all depths are sharp."""
    focus_m: MetresOfFocus | None = None
    """Depth along the axis that is in focus."""

    @model_validator(mode="after")
    def _has_a_focus(self) -> SimulatedLensSettings:
        if (self.aperture_m > 0) != (self.focus_m is not None):
            raise ValueError("aperture_m and focus_m belong together; give both")
        return self


class SimulatedCameraSettings(SimulatedLensSettings):
    """What the simulated camera really is."""

    sensitivity_e_per_s: Annotated[float, Field(gt=0)]
    """Electrons a second for a radiosity of 1."""
    full_well_e: Annotated[Electrons, Field(gt=0)] = 32000.0
    read_noise_e: Electrons = 6.0
    black_level_dn: Annotated[float, Field(ge=0)] = 64.0
    compression: Annotated[float, Field(ge=0, le=1)] = 0.0
    """Response y (1 + c) / (1 + c y): 0 is linear."""
    tone: Literal["linear", "srgb"] | Annotated[float, Field(ge=0.3, le=4.0)] = "linear"
    """Tone curve after it: none, that of sRGB, or the exponent g of y^(1 / g), as consumer cameras apply it."""
    s_shape: Annotated[float, Field(ge=0, le=0.6)] = 0.0
    """Share of a smooth step in it: a picture style, which darkens what is dark and brightens what is bright."""
    jpeg_quality: Annotated[int, Field(ge=1, le=100)] | None = None
    """Frames come as JPEG of that quality, as from a webcam that streams MJPEG; None: as the sensor has them."""
    stale_frame_rate: Share = 0.0
    """Frames that are old, and say so by their time stamps."""
    dropped_frame_rate: Share = 0.0
    duplicate_frame_rate: Share = 0.0
    """Frames that are copies of the one before, with a new time stamp and number."""
    short_frame_rate: Share = 0.0
    """Frames of which the lower half is missing."""
    sequence_restart_rate: Share = 0.0
    """Frames at which the counter begins anew."""
    time_stamp_jitter_s: SecondsOfDelay = 0.0
    """Largest error of a time stamp, either way."""
    pipeline_frames: FrameCount = 0
    """Frame periods by which what a frame shows is older than its time stamp."""
    exposure_delay_frames: FrameCount = 0
    """Frames for which a new exposure is not yet in force; they say so."""
    readout_s: SecondsOfDelay = 0.0
    """Rolling shutter: by how much the last row is exposed later than the first."""
    unplugged_s: tuple[Interval, ...] = ()
    frozen_s: tuple[Interval, ...] = ()
    """No frame comes, unless the camera is opened again."""


class SimulatedProjectorSettings(SimulatedLensSettings):
    """What the simulated projector really is."""

    flux: Annotated[float, Field(gt=0)] = 10.0
    """Power of all pixels together at white; relative."""
    contrast: Annotated[float, Field(gt=1)] = 1500.0
    """White over black, the whole picture black."""
    gamma: Gamma = (2.2,)
    """Of all channels, or of red, green and blue."""
    s_shape: Share = 0.0
    """Share of a smooth step in the response, the rest a power law."""
    latency_s: SecondsOfDelay = 0.0
    """From the time stamp of the display to light."""
    jitter_s: SecondsOfDelay = 0.0
    white_boost: Annotated[float, Field(ge=0)] = 0.0
    """A white segment's part: white is brighter by this share than red, green and blue together."""
    mixing: tuple[MixingRow, MixingRow, MixingRow] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    """Light that each band (row) of a colour camera gets from red, green and blue; a grey one sees the rows' mean."""
    lamp_drift: Annotated[float, Field(ge=-0.5, le=0.5)] = 0.0
    """By how much the lamp is darker at the clock's 0 than when it is warm, share of the latter."""
    lamp_warm_up_s: SecondsOfWarmUp = 60.0
    """In which all but 1/e of that is made up for."""
    unplugged_s: tuple[Interval, ...] = ()


class Poster(Table):
    """A rectangle of other reflectance on a face, in shares of the face's two edges."""

    face: FaceName
    lower: tuple[Share, Share]
    upper: tuple[Share, Share]
    reflectance: Colour


class SimulatedMaterial(Table):
    """What a part of a scene does with light; keys that are not given are the scene's own."""

    name: Annotated[str, Field(min_length=1)]
    """The material's in the mesh file or the library's scene; ``*`` for triangles that have no colour."""
    reflectance: Colour | None = None
    """Matte reflectance."""
    gloss: Reflectance | None = None
    """Share of light that a glossy lobe sends back, beside the matte part; 0: none."""
    roughness: Annotated[float, Field(ge=0.02, le=1.0)] | None = None
    """Width of the lobe (GGX alpha): 0.05 is a gloss floor, 0.3 satin paint."""


MOST_CELLS = 20_000
"""Of a simulated box: the light between them then takes 3.2 GB."""


class SimulationSettings(Table):
    """The whole truth of a simulated rig."""

    seed: int = 1
    scene: str | None = None
    """A scene of triangles: a mesh file, relative to the profile, or a name of the library; None: a box."""
    scene_unit: Literal["m", "cm", "mm", "in", "inch", "ft"] = "m"
    """What the numbers of a mesh file are."""
    scene_up: Literal["x", "y", "z", "-x", "-y", "-z"] | None = None
    """The mesh file's axis that points up; None: y of glTF, else z."""
    materials: Annotated[tuple[SimulatedMaterial, ...], Field(alias="material")] = ()
    """Overrule those of the scene, by name."""
    rays: Annotated[int, Field(ge=16, le=16384)] = 1024
    """From each sample of a scene's light to the rest of it."""
    size_m: Place = (0.0, 0.0, 0.0)
    """Of the box, or of the room of a library's scene; a mesh file has its own."""
    reflectance: dict[FaceName, Colour] = Field(default_factory=dict)
    """Mean reflectance of each face; a face of a box that is not named is open."""
    texture: Share = 0.0
    """Half range of the smooth variation on each face."""
    posters: tuple[Poster, ...] = ()
    cell_size_m: MetresOfPatch = 0.12
    pixel_samples: Annotated[int, Field(ge=1, le=4)] = 2
    """Samples of a pixel along each axis, of camera and projector."""
    ambient: Annotated[float, Field(ge=0)] = 0.0
    """Irradiance of room light on every surface; relative, as the projector's."""
    ambient_flicker_hz: HertzOfLight = 0.0
    """How often a second the room light swells; mains lamps do twice a period: 100 or 120."""
    ambient_flicker: Share = 0.0
    """By how much, share of its mean."""
    cameras: Annotated[tuple[SimulatedCameraSettings, ...], Field(alias="camera"), AT_LEAST_ONE]
    projectors: Annotated[tuple[SimulatedProjectorSettings, ...], Field(alias="projector"), AT_LEAST_ONE]

    @property
    def camera(self) -> SimulatedCameraSettings:
        """The only camera. Raises ValueError when there are several."""
        (camera,) = self.cameras
        return camera

    @property
    def projector(self) -> SimulatedProjectorSettings:
        """The only projector. Raises ValueError when there are several."""
        (projector,) = self.projectors
        return projector

    def with_device(self, device: SimulatedCameraSettings | SimulatedProjectorSettings) -> SimulationSettings:
        """Return the same settings, the camera or projector of that name replaced."""
        return self.model_copy(
            update={
                "cameras": tuple(device if one.name == device.name else one for one in self.cameras),
                "projectors": tuple(device if one.name == device.name else one for one in self.projectors),
            }
        )

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> SimulationSettings:
        """Return a copy with some keys replaced, not validated. Raises ValueError for what is no key."""
        unknown = set(update or ()) - set(type(self).model_fields)
        if unknown:
            raise ValueError(f"a simulation has no {', '.join(sorted(unknown))}; with_device() replaces one device")
        return super().model_copy(update=update, deep=deep)

    @property
    def is_mesh_file(self) -> bool:
        """Whether the scene is read from a file."""
        return self.scene is not None and "." in self.scene

    def of_pair(self, camera: str, projector: str) -> SimulationSettings:
        """Return the settings that one camera and one projector know, by name.

        The first camera and the first projector keep the seed; noise and jitter of the others are their own. Room
        light is the first projector's.
        """
        cameras, projectors = ([one.name for one in devices] for devices in (self.cameras, self.projectors))
        at_camera, at_projector = cameras.index(camera), projectors.index(projector)
        return self.model_copy(
            update={
                "cameras": (self.cameras[at_camera],),
                "projectors": (self.projectors[at_projector],),
                "seed": self.seed + _NEXT_SEED * max(at_camera, at_projector),
                "ambient": self.ambient if at_projector == 0 else 0.0,
            }
        )

    @property
    def _cells(self) -> float:
        """How many cells the faces of the box have."""
        x, y, z = self.size_m
        return 2 * (x * y + y * z + z * x) / self.cell_size_m**2

    @model_validator(mode="after")
    def _has_a_scene(self) -> SimulationSettings:
        if self.is_mesh_file:
            if self.size_m != (0.0, 0.0, 0.0) or self.reflectance:
                raise ValueError(
                    "size_m and reflectance are of a box; a mesh file has its own: use [[simulation.material]]"
                )
        elif min(self.size_m) <= 0:
            raise ValueError(f"size_m {self.size_m}: give the width, depth and height of the room, in metres")
        elif (cells := self._cells) > MOST_CELLS:
            raise ValueError(
                f"cell_size_m {self.cell_size_m:g} m makes {cells:.3g} cells of a room of {self.size_m}, the limit is "
                f"{MOST_CELLS}: the light between them would take {8e-9 * cells**2:.3g} GB; give larger cells"
            )
        if self.scene is None and not self.reflectance:
            raise ValueError("reflectance: missing; a box needs that of each face that is there")
        if self.scene is None and self.materials:
            raise ValueError("material: only for a scene; a box has reflectance and posters")
        if self.scene is not None and self.posters:
            raise ValueError("posters: only for a box; remove them, or scene")
        return self

    @model_validator(mode="after")
    def _devices_are_inside(self) -> SimulationSettings:
        if self.is_mesh_file:
            return self
        for lens in (*self.cameras, *self.projectors):
            there = tuple(at + by for at, by in zip(lens.position_m, lens.moved_m, strict=True))
            if not all(0.0 < p < s for p, s in zip(there, self.size_m, strict=True)):
                raise ValueError(f"position_m {there} of {lens.name!r} is outside size_m {self.size_m}")
        return self
