"""The simulated worlds of a profile, kept while the same are asked for.

Making them takes from half a second to a minute, and a page, a library's user or a resumed session opens the same rig
again and again. A world has no state: of the same settings, sizes and scene it is the same.
"""

from __future__ import annotations

import hashlib
import threading
from dataclasses import dataclass

from rig.devices.driver_settings import CameraSettings, ProjectorSettings, RigSettings
from rig.devices.simulated.devices import Bands
from rig.devices.simulated.mesh.exchange import Exchange
from rig.devices.simulated.mesh.find import find_scene
from rig.devices.simulated.mesh.scene import TriangleScene
from rig.devices.simulated.mesh.world import MeshWorld, exchange_of
from rig.devices.simulated.settings import SimulationSettings
from rig.devices.simulated.world import make_simulated_worlds
from rig.errors import ProfileError


@dataclass(frozen=True, slots=True)
class Pair:
    """A camera and a projector by name, and what a world has to know of them."""

    camera: str
    projector: str
    shapes: tuple[tuple[int, int], tuple[int, int]]
    """(H, W) of each."""
    channels: int

    @classmethod
    def of(cls, camera: CameraSettings, projector: ProjectorSettings, channels: int | None = None) -> Pair:
        """Return that of two devices; ``channels`` of a camera other than the profile's."""
        shapes = (camera.shape[:2], projector.shape)
        return cls(camera.name, projector.name, shapes, channels or camera.channels)


@dataclass(frozen=True, eq=False, slots=True)
class _Kept:
    settings: SimulationSettings
    scene: bytes
    pairs: tuple[Pair, ...]
    worlds: tuple[Bands, ...]

    def is_of(self, settings: SimulationSettings, scene: bytes, pairs: tuple[Pair, ...]) -> bool:
        return self.scene == scene and self.pairs == pairs and self.settings == settings


_kept: list[_Kept] = []
"""The last ones: those of a large room take gigabytes."""
_making = threading.Lock()


def worlds_of(profile: RigSettings, *pairs: Pair) -> tuple[Bands, ...]:
    """Return the world of each pair, in each band of its camera.

    Pairs of one call share what surfaces send to each other, found in their order.

    Raises
    ------
    ProfileError
        There is no simulation, its scene cannot be used, or a device looks past it.
    """
    settings: SimulationSettings | None = profile.simulation
    if settings is None:
        raise ProfileError(f"{profile.path}: simulation: missing; a simulated room needs a [simulation] table")
    try:
        scene = None if settings.scene is None else find_scene(settings, profile.path.parent)
        with _making:
            digest = b"" if scene is None else _digest(scene)
            if not (_kept and _kept[0].is_of(settings, digest, pairs)):
                _kept.clear()  # before the next are made: both may not fit into memory
                _kept.append(_Kept(settings, digest, pairs, _made(settings, scene, pairs)))
            return _kept[0].worlds
    except ProfileError as error:
        raise ProfileError(f"{profile.path}: {error}") from error


def _made(settings: SimulationSettings, scene: TriangleScene | None, pairs: tuple[Pair, ...]) -> tuple[Bands, ...]:
    exchange = None if scene is None else exchange_of(scene, settings)
    return tuple(_bands(settings.of_pair(pair.camera, pair.projector), exchange, pair) for pair in pairs)


def _bands(settings: SimulationSettings, exchange: Exchange | None, pair: Pair) -> Bands:
    if exchange is None:
        return make_simulated_worlds(settings, *pair.shapes, pair.channels)
    bands = (None,) if pair.channels == 1 else range(pair.channels)
    return tuple(MeshWorld(settings, exchange, *pair.shapes, band=band) for band in bands)


def _digest(scene: TriangleScene) -> bytes:
    arrays = scene.triangles_m, scene.material, scene.reflectance, scene.gloss, scene.roughness
    names = "\0".join((scene.name, *scene.materials)).encode()
    return hashlib.sha256(names + b"".join(array.tobytes() for array in arrays)).digest()
