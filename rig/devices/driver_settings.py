"""What a driver is told about the device that it makes: parts of a profile, which the drivers do not know.

A driver is a function that makes a closed device of its settings and the rig's clock: a :data:`CameraFactory` or a
:data:`ProjectorFactory`. Simulated and replayed devices share a world or a recording; a :data:`RigFactory` makes all
devices of a rig at once.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, Protocol, TypeAlias

from calibration.radiometry.mosaic import MosaicPattern
from rig.devices.protocols import Camera, Clock, ExposureRange, Projector

if TYPE_CHECKING:
    from rig.devices.simulated.settings import SimulationSettings


class CameraSettings(Protocol):
    """What a driver may ask about a camera: the profile's table [[camera]]."""

    @property
    def name(self) -> str:
        """The camera's name in its rig."""
        ...

    @property
    def driver(self) -> str:
        """Which driver makes it."""
        ...

    @property
    def device_id(self) -> str | None:
        """Which camera of this machine."""
        ...

    @property
    def pixel_format(self) -> str | None:
        """Four characters, as V4L2 calls them."""
        ...

    @property
    def controls(self) -> Mapping[str, int]:
        """The driver's controls, by name."""
        ...

    @property
    def options(self) -> Mapping[str, object]:
        """What else the driver wants to know: the table [camera.options], as TOML gives it."""
        ...

    @property
    def shape(self) -> tuple[int, int, int]:
        """(height, width, numbers a pixel) of its frames."""
        ...

    @property
    def channels(self) -> int:
        """Bands of light that it tells apart: 1 or 3."""
        ...

    @property
    def mosaic(self) -> MosaicPattern | None:
        """Colour filters of a sensor whose frames have one number a pixel, and three channels all the same."""
        ...

    @property
    def bit_depth(self) -> int:
        """Of its numbers; ``2 ** bit_depth - 1`` is saturated."""
        ...

    @property
    def full_scale_dn(self) -> int:
        """The largest digital number."""
        ...

    @property
    def frame_rate_hz(self) -> float:
        """Frames a second."""
        ...

    @property
    def exposure_range_s(self) -> ExposureRange:
        """Shortest and longest exposure."""
        ...


class PjlinkSettings(Protocol):
    """The projector's table [projector.pjlink]."""

    @property
    def host(self) -> str:
        """Name or address."""
        ...

    @property
    def port(self) -> int:
        """TCP port."""
        ...

    @property
    def password_variable(self) -> str | None:
        """Environment variable that holds the password."""
        ...

    @property
    def input(self) -> str | None:
        """PJLink's code of the input."""
        ...

    @property
    def warm_up_timeout_s(self) -> float:
        """How long to wait until the lamp is on."""
        ...


class LightCrafterSettings(Protocol):
    """The projector's table [projector.lightcrafter]."""

    @property
    def serial(self) -> str | None:
        """USB serial number."""
        ...

    @property
    def led_currents(self) -> tuple[int, int, int] | None:
        """Red, green, blue, in the controller's steps."""
        ...


class ProjectorSettings(Protocol):
    """What a driver may ask about a projector: the profile's table [[projector]]."""

    @property
    def name(self) -> str:
        """The projector's name in its rig."""
        ...

    @property
    def output(self) -> str | None:
        """Which output of this machine."""
        ...

    @property
    def options(self) -> Mapping[str, object]:
        """What else the driver wants to know: the table [projector.options], as TOML gives it."""
        ...

    @property
    def shape(self) -> tuple[int, int]:
        """(height, width), in pixels."""
        ...

    @property
    def refresh_rate_hz(self) -> float:
        """Pictures a second."""
        ...

    @property
    def driver(self) -> str:
        """Which driver makes it."""
        ...

    @property
    def pjlink(self) -> PjlinkSettings | None:
        """Its own network control."""
        ...

    @property
    def lightcrafter(self) -> LightCrafterSettings | None:
        """Its USB control."""
        ...


class RigSettings(Protocol):
    """What the makers of a whole rig may ask: its profile."""

    @property
    def path(self) -> Path:
        """Of the profile, for messages."""
        ...

    @property
    def camera(self) -> CameraSettings:
        """The only camera."""
        ...

    @property
    def projector(self) -> ProjectorSettings:
        """The only projector."""
        ...

    @property
    def cameras(self) -> Sequence[CameraSettings]:
        """All of them."""
        ...

    @property
    def projectors(self) -> Sequence[ProjectorSettings]:
        """All of them."""
        ...

    @property
    def simulation(self) -> SimulationSettings | None:
        """The simulated truth."""
        ...

    @property
    def recording(self) -> Path:
        """Manifest of the photographs, or folder of the session, that is replayed. Raises ProfileError."""
        ...

    @property
    def recorded(self) -> RigSettings | None:
        """The rig of the session that is replayed; None for photographs. Raises ProfileError."""
        ...


class Devices(NamedTuple):
    """Cameras and projectors by name, on one clock; closed."""

    cameras: Mapping[str, Camera]
    projectors: Mapping[str, Projector]
    clock: Clock

    @property
    def camera(self) -> Camera:
        """The only camera. Raises ValueError when there are several."""
        (camera,) = self.cameras.values()
        return camera

    @property
    def projector(self) -> Projector:
        """The only projector. Raises ValueError when there are several."""
        (projector,) = self.projectors.values()
        return projector


CameraFactory: TypeAlias = Callable[[CameraSettings, Clock], Camera]
"""Makes a camera, closed. Raises ProfileError for settings that make no sense to it."""
ProjectorFactory: TypeAlias = Callable[[ProjectorSettings, Clock], Projector]
"""Makes a projector, closed. Raises ProfileError for settings that make no sense to it."""
RigFactory: TypeAlias = Callable[[RigSettings, Clock], Devices]
"""Makes every device of a rig, closed. Raises ProfileError."""
