"""The simulated world of a scene of triangles: one camera, one projector, one band of light."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rig.devices.simulated.defocus import circle_px
from rig.devices.simulated.mesh.exchange import Exchange
from rig.devices.simulated.mesh.paths import camera_paths, light_on, projector_paths
from rig.devices.simulated.mesh.refine import refined
from rig.devices.simulated.mesh.scene import FloatArray, TriangleScene, made_fit
from rig.devices.simulated.mesh.shading import ProjectorLight, Reflectance
from rig.devices.simulated.optics import blurred, directions, haloed
from rig.devices.simulated.pair import Light, SeenSurface, SimulatedPair, pixel_grid
from rig.devices.simulated.settings import SimulationSettings
from rig.errors import ProfileError

Float32Array = NDArray[np.float32]

_BLUR_REACH = 4.0
"""Standard deviations of the lens's blur that light reaches beyond the picture."""
_NEAR_M = 0.05
"""How far from the true surface a model's patch still is that surface; chosen: ten times what calibration leaves."""


def exchange_of(scene: TriangleScene, settings: SimulationSettings) -> Exchange:
    """Cut a scene into cells, which all its cameras, projectors and bands share.

    Raises
    ------
    ProfileError
        It cannot be used as it is, or Embree is not installed.
    """
    fit = made_fit(scene, np.sqrt(2) * settings.cell_size_m)
    tracer, grid, partitions = refined(fit, settings.cell_size_m)
    return Exchange(tracer, grid, partitions, rays=settings.rays, seed=settings.seed)


class MeshWorld(SimulatedPair):
    """Any mesh, with the optics and response of a simulated rig: shadows, gloss, and light from wall to wall.

    Parameters
    ----------
    settings
        Of one camera and one projector (:meth:`SimulationSettings.of_pair`).
    exchange
        The scene.
    camera_shape, projector_shape : (H, W)
    band : int, optional
        Of a colour camera; None: a grey one.

    Raises
    ------
    ProfileError
        Camera or projector looks past the scene.
    """

    def __init__(
        self,
        settings: SimulationSettings,
        exchange: Exchange,
        camera_shape: tuple[int, int],
        projector_shape: tuple[int, int],
        *,
        band: int | None = None,
    ):
        super().__init__(settings, camera_shape, projector_shape, band)
        self._exchange = exchange
        self._reflectance = Reflectance(exchange.tracer, band, settings.texture)
        self._surface = self._look()
        self._margin_px = self._reach_px()
        light = ProjectorLight(
            tracer=exchange.tracer, optics=self.projector, flux=settings.projector.flux, margin_px=self._margin_px
        )
        samples, seed = settings.pixel_samples, settings.seed
        self._seen = camera_paths(exchange, self.camera, light, self._reflectance, samples=samples, seed=seed)
        self._sent = projector_paths(exchange, light, samples=samples, seed=seed)
        if not self._sent.landing.nnz:
            raise ProfileError(f"simulation.projector.{settings.projector.name}: lights nothing of the scene; turn it")
        exchange.require(np.unique(self._seen.view.indices))

    def light_of(self, linear: Float32Array) -> Light:
        """Radiosity for a picture in linear light, (H, W), 1 = white."""
        linear = haloed(self.projector, linear)
        m, n_pixels = self._margin_px, self.camera.shape[0] * self.camera.shape[1]
        wide = np.pad(np.asarray(linear, np.float32), m)
        picture = blurred(self.projector, wide, margin_px=m)
        emission = self._cell_reflectance * (self._sent.landing @ linear.ravel())
        irradiance = self._exchange.irradiance(emission, self._sent.by_gloss @ linear.ravel(), self._cell_reflectance)
        direct = light_on(n_pixels, self._seen.direct, picture, m).reshape(self.camera.shape)
        mirrored = light_on(n_pixels, self._seen.mirrored, picture, m)
        global_ = (self._seen.view @ irradiance + mirrored).reshape(self.camera.shape)
        return Light(direct, np.asarray(global_, dtype=np.float32), self.ambient)

    @cached_property
    def ambient(self) -> Float32Array:
        """(H, W) radiosity of even room light on every surface, with its interreflection."""
        even = np.float32(self.settings.ambient)
        if not even:
            return np.zeros(self.camera.shape, dtype=np.float32)
        nothing = np.zeros(2 * self._exchange.grid.n_nodes, dtype=np.float32)
        indirect = self._exchange.irradiance(self._cell_reflectance * even, nothing, self._cell_reflectance)
        return np.asarray((self._seen.view @ (indirect + even)).reshape(self.camera.shape), dtype=np.float32)

    @property
    def surface(self) -> SeenSurface:
        """What the camera's pixels look at."""
        return self._surface

    @property
    def exchange(self) -> Exchange:
        """The scene, and what its surfaces send to each other."""
        return self._exchange

    def reflectance_near(self, points_m: FloatArray, normal: FloatArray) -> FloatArray:
        """Return (n,) matte reflectance within 5 cm of points, along (3,) or (n, 3); NaN where nothing is."""
        tracer = self._exchange.tracer
        hits = tracer.hits(points_m + _NEAR_M * normal, np.broadcast_to(-normal, points_m.shape))
        landed = tracer.points_m(hits)
        near = ~hits.escaped & (np.linalg.norm(landed - points_m, axis=1) <= _NEAR_M)
        return np.where(near, self._reflectance.at(hits.facet, landed), np.nan)

    @cached_property
    def _cell_reflectance(self) -> Float32Array:
        """(2 C,) at the cells' middles."""
        grid = self._exchange.grid
        value = self._reflectance.at(grid.facet_of_cell, grid.cell_corners_m.mean(axis=1))
        return np.tile(value, 2).astype(np.float32)

    def _look(self) -> SeenSurface:
        tracer = self._exchange.tracer
        rays = directions(self.camera, pixel_grid(self.camera.shape)).reshape(-1, 3)
        hits = tracer.hits(self.camera.position_m, rays)
        missed = hits.escaped
        if missed.all():
            raise ProfileError(
                f"simulation.camera.{self.settings.camera.name}: sees nothing of the scene; turn it, or check "
                "scene_unit and scene_up"
            )
        points = tracer.points_m(hits)
        values = np.stack([*points.T, *tracer.normals_towards(hits).T, self._reflectance.at(hits.facet, points)])
        values[:, missed] = np.nan
        seen = values.reshape(-1, *self.camera.shape)
        return SeenSurface(
            points_m=np.moveaxis(seen[:3], 0, -1), normals=np.moveaxis(seen[3:6], 0, -1), reflectance=seen[6]
        )

    def _reach_px(self) -> int:
        """How far beyond its picture the projector's blurred light reaches, at the depths that are seen."""
        lens = self.settings.projector
        blur = _BLUR_REACH * max(lens.blur_px, lens.corner_blur_px or 0.0)
        depth = self.projector.depth_m(self._surface.points_m)
        circle = circle_px(self.projector, depth[depth > 0]) if (depth > 0).any() else np.zeros(1)
        return int(np.ceil(max(blur, float(np.max(circle)) / 2) + 1))
