"""From scene, gloss and lenses to a glossy light transport, by rays that never change.

Units are those of ``sim.light.transport_of_scene``, convention ``physical``.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.sparse import coo_array, csr_array, diags_array

from sim.arguments import check_kind, word_of
from sim.arrays import FloatArray, IntArray
from sim.errors import SimulationError
from sim.geometry.interpolation import bilinear
from sim.geometry.optics import Lens, Pose, project, rays_at
from sim.geometry.scene import Scene
from sim.geometry.surface import Surface
from sim.light.gloss.exchange import RAYS_AT_A_TIME, glossy_form_factors
from sim.light.gloss.lobe import frames_of, lobe
from sim.light.gloss.material import Gloss
from sim.light.gloss.transport import GlossyTransport
from sim.light.gloss.walks import GlossySurface, LightLeg, even_points
from sim.light.radiosity import FormFactorOperator, Radiosity
from sim.light.transport_of_scene import area_emission, irradiance_at, smooth_view

Mirrored = Literal["pixel", "patch"]


@dataclass(frozen=True, kw_only=True)
class GlossSampling:
    """How many rays follow light over gloss, and which.

    Raises
    ------
    SimulationError
        For a number of rays below 1.
    """

    patch_rays: int = 256
    """Pairs of rays from each glossy patch, for light between patches."""
    projector_rays: int = 8
    """From each part of a projector pixel that lands on gloss."""
    camera_rays: int = 32
    """From each camera pixel that sees gloss."""
    seed: int = 0
    """Another one for other rays."""

    def __post_init__(self) -> None:
        fewest = min(self.patch_rays, self.projector_rays, self.camera_rays)
        if fewest < 1:
            raise SimulationError(f"gloss by {fewest} rays; give at least 1")


def glossy_transport(
    surface: Surface,
    form_factors: FormFactorOperator,
    projector_lens: Lens,
    projector_pose: Pose,
    *,
    gloss: Gloss,
    camera_lens: Lens | None = None,
    camera_pose: Pose | None = None,
    subsamples: int = 2,
    mirrored: Mirrored = "pixel",
    sampling: GlossSampling | None = None,
) -> GlossyTransport:
    """Return the light transport of a camera and a projector among glossy surfaces.

    Parameters
    ----------
    surface : Surface
        Its reflectance is the matte part. On a ``Scene`` indirect light is bilinear between patches, on meshes it is
        constant a patch.
    form_factors : FormFactorOperator
        Of that surface, straight from patch to patch.
    projector_lens, projector_pose
        Of the projector.
    gloss : Gloss
        The patches' lobes.
    camera_lens, camera_pose
        Of the camera; left out: it is in the projector's place, with its lens, and T is square with a diagonal D.
    subsamples : int
        Each projector pixel is split into subsamples x subsamples.
    mirrored : {"pixel", "patch"}
        How the projector's picture on other patches is seen in a glossy one: as it lies there, or constant a patch,
        which is what compensation can invert.
    sampling : GlossSampling, optional
        Rays.

    Returns
    -------
    GlossyTransport
        (camera pixels, projector pixels).

    Raises
    ------
    SimulationError
        For parts that do not belong together, a camera of which only lens or pose is given, or reflection above 1.
    """
    check_kind("light transport", surface, "vertices", "a scene or mesh")
    word_of("way to mirror the picture", mirrored, ("pixel", "patch"))
    if (camera_lens is None) != (camera_pose is None):
        raise SimulationError("light transport: a camera needs lens and pose; give both, or neither")
    sampling = sampling or GlossSampling()
    light = _ProjectorLight(
        glossy=GlossySurface.of(surface, gloss),
        lens=projector_lens,
        pose=projector_pose,
        coaxial=camera_lens is None,
    )
    extended = glossy_form_factors(surface, form_factors, gloss, rays=max(16, sampling.patch_rays), seed=sampling.seed)
    camera = camera_lens or projector_lens, camera_pose or projector_pose
    seen = _seen(light, *camera, sampling=sampling, mirrored=mirrored)
    hits = light.glossy.first_leg(
        projector_pose.position_m,
        rays_at(projector_lens, projector_pose, projector_lens.pixel_grid()),
        np.ones(projector_lens.n_pixels),
    )
    pixel_patch = np.full(projector_lens.n_pixels, -1, dtype=np.intp)
    pixel_patch[hits.walk] = hits.patch
    return GlossyTransport(
        seen.direct,
        area_emission(surface, projector_lens, projector_pose, subsamples=subsamples, convention="physical"),
        Radiosity(extended, surface.reflectance, solver="repeated"),
        seen.view,
        by_gloss=_emission_by_gloss(light, subsamples, sampling),
        lobe_view=seen.lobe_view,
        mirrored=seen.mirrored,
        pixel_patch=pixel_patch,
        pixel_xy_px=projector_lens.pixel_grid(),
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class _ProjectorLight:
    """A projector among glossy patches."""

    glossy: GlossySurface
    lens: Lens
    pose: Pose
    coaxial: bool
    """The camera's pixels are the projector's own."""

    def sent_back(self, leg: LightLeg) -> csr_array:
        """(rays, n_projector) radiosity of places along their rays, highlights too, times the rays' shares."""
        surface, points = self.glossy.surface, leg.points_m
        xy = project(self.lens, self.pose, points)
        with np.errstate(invalid="ignore"):
            inside = ((xy > -0.5) & (xy < np.array([self.lens.width_px, self.lens.height_px]) - 0.5)).all(axis=1)
        rays = np.flatnonzero(inside)
        leg, xy = leg.of(rays), xy[inside]
        value = irradiance_at(surface, self.lens, self.pose, points_m=leg.points_m, patch=leg.patch)
        value = value * leg.share * (np.asarray(surface.reflectance)[leg.patch] + self._highlight(leg))
        rows, columns, weights = bilinear(xy, self.lens.width_px, self.lens.height_px)
        shape = (len(points), self.lens.n_pixels)
        place = np.repeat(rays, 4), (rows * self.lens.width_px + columns).ravel()
        return _csr((value[:, None] * weights).ravel(), *place, shape)

    def diagonal(self, leg: LightLeg) -> csr_array:
        """Direct light of a camera in the projector's place: of its own pixel alone."""
        surface = self.glossy.surface
        value = irradiance_at(surface, self.lens, self.pose, points_m=leg.points_m, patch=leg.patch)
        direct = np.zeros(self.lens.n_pixels)
        direct[leg.walk] = value * (np.asarray(surface.reflectance)[leg.patch] + self._highlight(leg))
        return csr_array(diags_array(direct))

    def _highlight(self, leg: LightLeg) -> FloatArray:
        """(N,) π ρ_s f_s between the projector and where the rays came from."""
        value = np.zeros(len(leg.walk))
        on = np.flatnonzero(self.glossy.gloss.glossy[leg.patch])
        patch = leg.patch[on]
        axes = frames_of(self.glossy.surface.normals[patch])
        way = self.pose.position_m - leg.points_m[on]
        way /= np.linalg.norm(way, axis=1, keepdims=True)
        coming, going = (np.einsum("nij,nj->ni", axes, each) for each in (way, -leg.directions[on]))
        value[on] = np.pi * self.glossy.gloss.share[patch] * lobe(coming, going, self.glossy.gloss.roughness[patch])
        return value


@dataclass(frozen=True, eq=False, kw_only=True)
class _SeenMatrices:
    """What the camera's pixels see."""

    direct: csr_array
    view: csr_array
    lobe_view: csr_array
    mirrored: csr_array | None


def _seen(
    light: _ProjectorLight, lens: Lens, pose: Pose, *, sampling: GlossSampling, mirrored: Mirrored
) -> _SeenMatrices:
    surface, n_pixels = light.glossy.surface, lens.n_pixels
    leg = light.glossy.first_leg(pose.position_m, rays_at(lens, pose, lens.pixel_grid()), np.ones(n_pixels))
    direct = light.diagonal(leg) if light.coaxial else _by_walk(light.sent_back(leg), leg.walk, n_pixels)
    lobe_view, picture = csr_array((n_pixels, surface.n_patches)), csr_array((n_pixels, light.lens.n_pixels))
    for further in _from_gloss(light.glossy, leg, sampling.camera_rays, (sampling.seed, 2)):
        seen = csr_array(diags_array(further.share) @ _view(surface, further))
        lobe_view = lobe_view + _by_walk(seen, further.walk, n_pixels)
        if mirrored == "pixel":
            picture = picture + _by_walk(light.sent_back(further), further.walk, n_pixels)
    return _SeenMatrices(
        direct=direct,
        view=_by_walk(_view(surface, leg), leg.walk, n_pixels),
        lobe_view=csr_array(lobe_view),
        mirrored=csr_array(picture) if mirrored == "pixel" else None,
    )


def _from_gloss(glossy: GlossySurface, leg: LightLeg, rays: int, seed: tuple[int, int]) -> Iterator[LightLeg]:
    """Follow so many rays from each of a leg's places on gloss; shares are of the place's light, walks its numbers."""
    places = np.flatnonzero(glossy.gloss.glossy[leg.patch])
    square, step = even_points(rays, 2), max(1, RAYS_AT_A_TIME // rays)
    for first in range(0, len(places), step):
        some = leg.of(places[first : first + step])
        random = np.random.default_rng((*seed, first))
        chances = (square + random.uniform(size=(len(some.walk), 1, 2))) % 1.0
        each = some.of(np.repeat(np.arange(len(some.walk)), rays))
        for further in glossy.further(each, chances.reshape(-1, 2), random):
            yield LightLeg(
                walk=further.walk,
                patch=further.patch,
                hits=further.hits,
                points_m=further.points_m,
                directions=further.directions,
                share=further.share / rays,
            )


def _emission_by_gloss(light: _ProjectorLight, subsamples: int, sampling: GlossSampling) -> csr_array:
    """S_s: parts of each pixel's light that land on gloss go on, and add to the patches that they reach."""
    lens, pose, surface = light.lens, light.pose, light.glossy.surface
    shape = (surface.n_patches, lens.n_pixels)
    total, grid = csr_array(shape), lens.pixel_grid()
    flux = 1 / (lens.focal_px[0] * lens.focal_px[1] * subsamples**2)
    offsets = (np.arange(subsamples) + 0.5) / subsamples - 0.5
    for part, (dy, dx) in enumerate(np.stack(np.meshgrid(offsets, offsets), axis=-1).reshape(-1, 2)):
        rays = rays_at(lens, pose, grid + np.array([dx, dy]))
        leg = light.glossy.first_leg(pose.position_m, rays, np.ones(lens.n_pixels))
        for further in _from_gloss(light.glossy, leg, sampling.projector_rays, (sampling.seed, 3 + part)):
            value = flux * further.share * (np.asarray(surface.reflectance) / surface.areas)[further.patch]
            total = total + _csr(value, further.patch, further.walk, shape)
    return csr_array(total)


def _view(surface: Surface, leg: LightLeg) -> csr_array:
    """(rays, P) what rays see of the patches' B - S p where they land."""
    if isinstance(surface, Scene):
        return smooth_view(surface, leg.hits, np.asarray(surface.reflectance)[leg.patch])
    rows = np.arange(len(leg.walk))
    return _csr(np.ones(len(rows)), rows, leg.patch, (len(rows), surface.n_patches))


def _by_walk(rows: csr_array, walk: IntArray, n_walks: int) -> csr_array:
    """Sum rows of rays in the rows of their walks."""
    gather = csr_array((np.ones(len(walk)), (walk, np.arange(len(walk)))), shape=(n_walks, len(walk)))
    return csr_array(gather @ rows)


def _csr(values: FloatArray, rows: IntArray, columns: IntArray, shape: tuple[int, int]) -> csr_array:
    return csr_array(coo_array((values, (rows, columns)), shape=shape))
