"""From scene and lenses to a light transport: which pixel lights, and sees, which patch.

Two conventions. ``paper``: camera and projector share pose and lens, radiosity from a pixel is rho cos(theta)
L with no fall-off (eq. 4). ``physical``: every projector pixel at 1 sends the same flux 1 / (fx fy), so that
irradiance is cos(theta) / (r² cos³ gamma), gamma from the optical axis: **the unit is the irradiance of a
white pixel on a plane across the optical axis at 1 m**. Camera values are radiosity (radiance times pi) in
the same unit.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.sparse import coo_array, csr_array, diags_array

from sim.arguments import check_kind
from sim.arrays import BoolArray, FloatArray, IntArray
from sim.errors import SimulationError
from sim.form_factors import FormFactors
from sim.geometry.interpolation import bilinear
from sim.geometry.mesh import Mesh
from sim.geometry.optics import Lens, Pose, project, rays_at, solid_angles
from sim.geometry.rays import trace
from sim.geometry.scene import Hits, Scene
from sim.geometry.surface import Surface
from sim.light.mesh_view import mesh_view
from sim.light.radiosity import Radiosity
from sim.light.transport import LightTransport

__all__ = [
    "LightTransport",
    "area_emission",
    "coaxial_transport",
    "irradiance_at",
    "physical_transport",
    "smooth_view",
]

Convention = Literal["paper", "physical"]
EmissionRule = Literal["pixel_mean", "area"]

PIXELS_AT_A_TIME = 1 << 17
"""Rays of so many take some 0.1 s on one core."""


def coaxial_transport(
    scene: Surface,
    form_factors: FormFactors,
    lens: Lens,
    pose: Pose,
    *,
    convention: Convention = "paper",
    emission_rule: EmissionRule = "pixel_mean",
    subsamples: int = 2,
) -> LightTransport:
    """Return the light transport of camera and projector in one place with one lens: pixel k of both is the same.

    Parameters
    ----------
    scene : Surface
    form_factors : FormFactors
        Of that scene.
    lens, pose
        Of camera and projector.
    convention : {"paper", "physical"}
        ``paper``: D = rho cos(theta), no fall-off (eqs. 4, 9). ``physical``: over r² cos³ gamma.
    emission_rule : {"pixel_mean", "area"}
        ``pixel_mean``: eq. 5, the mean over a patch's pixels; half-lit patches count as lit. ``area``: the
        light that lands on the patch over its area.
    subsamples : int
        ``area``: each pixel is split into subsamples x subsamples.

    Returns
    -------
    LightTransport
        Square, its direct part diagonal.

    Raises
    ------
    SimulationError
        For an unknown convention or emission rule.

    References
    ----------
    Dehos, Zéghers, Sarry, Rousselle and Renaud, Virtual Reality 18(2), 2014; equations 4, 5 and 9.
    """
    check_kind("light transport", scene, "tracer", "a scene")
    _check_choices(convention, emission_rule)
    beam = _beam(scene, lens, pose, lens.pixel_grid())
    intensity = 1 / (lens.focal_px[0] * lens.focal_px[1] * solid_angles(lens, lens.pixel_grid()))
    falloff = np.ones(lens.n_pixels)
    if convention == "physical":
        falloff = intensity / np.where(beam.lit, beam.hits.distance, 1.0) ** 2
    direct = np.where(beam.lit, beam.reflectance * beam.hits.cos_incidence * falloff, 0.0)
    if emission_rule == "pixel_mean":
        emission = _pixel_mean(scene, beam.hits.patch, direct)
    else:
        emission = area_emission(scene, lens, pose, subsamples=subsamples, convention=convention)
    pixels = np.flatnonzero(beam.lit)
    view = _csr(np.ones(len(pixels)), pixels, beam.hits.patch[pixels], (lens.n_pixels, scene.n_patches))
    radiosity = Radiosity(form_factors, scene.reflectance, solver="repeated")
    direct_matrix = csr_array(diags_array(direct))
    return LightTransport(
        direct_matrix, emission, radiosity, view, pixel_patch=beam.hits.patch, pixel_xy_px=lens.pixel_grid()
    )


def physical_transport(
    scene: Surface,
    form_factors: FormFactors,
    projector_lens: Lens,
    projector_pose: Pose,
    *,
    camera_lens: Lens,
    camera_pose: Pose,
    subsamples: int = 2,
) -> LightTransport:
    """Return the light transport of camera and projector each in its place, in the ``physical`` unit of this module.

    Direct light: each camera pixel takes the projector pixels about its surface point, bilinearly, where the
    projector sees that point. Indirect light: bilinear between the patch centres of a face.

    Parameters
    ----------
    scene : Surface
    form_factors : FormFactors
        Of that scene.
    projector_lens, projector_pose
        Of the projector.
    camera_lens, camera_pose
        Of the camera.
    subsamples : int
        Each projector pixel is split into subsamples x subsamples for the light that lands on a patch.

    Returns
    -------
    LightTransport
        (camera pixels, projector pixels).
    """
    radiosity = Radiosity(form_factors, scene.reflectance, solver="repeated")
    emission = area_emission(scene, projector_lens, projector_pose, subsamples=subsamples, convention="physical")
    beam = _beam(scene, projector_lens, projector_pose, projector_lens.pixel_grid())
    seen = _beam(scene, camera_lens, camera_pose, camera_lens.pixel_grid())
    direct = _direct(scene, projector_lens, projector_pose, seen)
    view = smooth_view(scene, seen.hits, seen.reflectance)
    return LightTransport(
        direct, emission, radiosity, view, pixel_patch=beam.hits.patch, pixel_xy_px=projector_lens.pixel_grid()
    )


@dataclass(frozen=True, eq=False)
class _Beam:
    """Rays of a device and what they meet."""

    origin_m: FloatArray
    rays: FloatArray
    hits: Hits
    reflectance: FloatArray
    """(N,) of the patch met; 0 for none."""

    @property
    def lit(self) -> BoolArray:
        return np.asarray(self.hits.patch >= 0)


def _beam(surface: Surface, lens: Lens, pose: Pose, xy_px: FloatArray) -> _Beam:
    rays = rays_at(lens, pose, xy_px)
    hits = trace(surface, pose.position_m, rays)
    reflectance = np.where(hits.patch >= 0, surface.reflectance[hits.patch], 0.0)
    return _Beam(pose.position_m, rays, hits, reflectance)


def _check_choices(convention: str, emission_rule: str) -> None:
    if convention not in ("paper", "physical"):
        raise SimulationError(f"unknown convention {convention!r}; there are paper, physical")
    if emission_rule not in ("pixel_mean", "area"):
        raise SimulationError(f"unknown emission rule {emission_rule!r}; there are pixel_mean, area")


def _csr(values: FloatArray, rows: IntArray, columns: IntArray, shape: tuple[int, int]) -> csr_array:
    # scipy sums what falls on the same place.
    return csr_array(coo_array((values, (rows, columns)), shape=shape))


def _pixel_mean(scene: Surface, patch: IntArray, direct: FloatArray) -> csr_array:
    """S of eq. 5: each patch takes the mean over the pixels that reach it."""
    pixels = np.flatnonzero(patch >= 0)
    count = np.bincount(patch[pixels], minlength=scene.n_patches)
    values = direct[pixels] / count[patch[pixels]]
    return _csr(values, patch[pixels], pixels, (scene.n_patches, len(patch)))


def area_emission(surface: Surface, lens: Lens, pose: Pose, *, subsamples: int, convention: Convention) -> csr_array:
    """Return S by area: the light of each pixel's parts that land on a patch, over its area.

    Parameters
    ----------
    surface : Surface
    lens, pose
        Of the projector.
    subsamples : int
        Each pixel is split into subsamples x subsamples.
    convention : {"paper", "physical"}

    Returns
    -------
    (P, n_projector) csr
    """
    grid = lens.pixel_grid()
    offsets = (np.arange(subsamples) + 0.5) / subsamples - 0.5
    total = csr_array((surface.n_patches, lens.n_pixels))
    for dy in offsets:
        for dx in offsets:
            # In pieces, so that no step is long: between steps a program hears that it is to end.
            places = grid + np.array([dx, dy])
            pieces = [
                _landed(surface, lens, pose, xy_px=places[first : first + PIXELS_AT_A_TIME], convention=convention)
                for first in range(0, lens.n_pixels, PIXELS_AT_A_TIME)
            ]
            flux, patch = (np.concatenate(parts) for parts in zip(*pieces, strict=True))
            lit = np.flatnonzero(patch >= 0)
            values = flux[lit] / (surface.areas[patch[lit]] * subsamples**2)
            total = total + _csr(values, patch[lit], lit, total.shape)
    return total


def _landed(
    surface: Surface, lens: Lens, pose: Pose, *, xy_px: FloatArray, convention: Convention
) -> tuple[FloatArray, IntArray]:
    """(N,) reflectance times flux of light through image points, and the patch that it lands on, -1 for none."""
    beam = _beam(surface, lens, pose, xy_px)
    flux = np.full(len(xy_px), 1 / (lens.focal_px[0] * lens.focal_px[1]))
    if convention == "paper":
        # Irradiance cos(theta) over the part's footprint, solid angle r² / cos(theta).
        flux = solid_angles(lens, xy_px) * np.where(beam.lit, beam.hits.distance, 0.0) ** 2
    return beam.reflectance * flux, beam.hits.patch


def _direct(scene: Surface, lens: Lens, pose: Pose, seen: _Beam) -> csr_array:
    """D: radiosity rho cos(theta) I / r² of the camera's points, from four projector pixels each."""
    camera = np.flatnonzero(seen.lit)
    points = seen.origin_m + seen.hits.distance[camera, None] * seen.rays[camera]
    xy = project(lens, pose, points)
    with np.errstate(invalid="ignore"):
        inside = ((xy > -0.5) & (xy < np.array([lens.width_px, lens.height_px]) - 0.5)).all(axis=1)
    camera, points, xy = camera[inside], points[inside], xy[inside]
    value = seen.reflectance[camera] * irradiance_at(scene, lens, pose, points_m=points, patch=seen.hits.patch[camera])
    rows, columns, weights = bilinear(xy, lens.width_px, lens.height_px)
    return _csr(
        (value[:, None] * weights).ravel(),
        np.repeat(camera, 4),
        (rows * lens.width_px + columns).ravel(),
        (len(seen.rays), lens.n_pixels),
    )


def irradiance_at(surface: Surface, lens: Lens, pose: Pose, *, points_m: FloatArray, patch: IntArray) -> FloatArray:
    """Return the irradiance cos(theta) I / r² of white at surface points inside the picture; 0 in shadow.

    Parameters
    ----------
    surface : Surface
    lens, pose
        Of the projector.
    points_m : (N, 3) array
        [m]
    patch : (N,) int array
        The patch that each point lies on.

    Returns
    -------
    (N,) array
        In the ``physical`` unit of this module.
    """
    to_point = points_m - pose.position_m
    distance = np.linalg.norm(to_point, axis=1)
    cosine = -np.einsum("nk,nk->n", to_point, surface.normals[patch]) / distance
    lit = (cosine > 0) & _reaches(surface, pose.position_m, to_point, distance)
    xy = project(lens, pose, points_m)
    intensity = 1 / (lens.focal_px[0] * lens.focal_px[1] * solid_angles(lens, xy))
    return np.asarray(np.where(lit, cosine * intensity / distance**2, 0.0))


def _reaches(surface: Surface, origin: FloatArray, to_point: FloatArray, distance: FloatArray) -> BoolArray:
    """Tell where nothing stands between the origin and the points."""
    if surface.convex:
        return np.ones(len(distance), dtype=bool)
    hits = trace(surface, origin, to_point / distance[:, None])
    return np.asarray(hits.distance >= distance * (1 - 1e-6))


def smooth_view(scene: Surface, hits: Hits, reflectance: FloatArray) -> csr_array:
    """Return V for pixels with these hits: the irradiance (B - E) / rho is bilinear between patch centres of a face.

    On a mesh it is linear between centroids and corners (:func:`sim.light.mesh_view.mesh_view`).

    Parameters
    ----------
    scene : Surface
    hits : Hits
        Where the N pixels look.
    reflectance : (N,) array
        Of the surface point that each pixel sees (camera vignetting may be in it).

    Returns
    -------
    (N, P) csr
    """
    if isinstance(scene, Mesh):
        return mesh_view(scene, hits, reflectance)
    if not isinstance(scene, Scene):
        raise SimulationError(f"no view of {scene.name}: it is neither gridded rectangles nor a mesh; make it one")
    pieces = []
    shape = (len(hits.patch), scene.n_patches)
    for index, face in enumerate(scene.faces):
        pixels = np.flatnonzero((hits.patch >= 0) & (hits.face == index))
        cells = hits.uv[pixels] * (face.columns, face.rows) - 0.5
        rows, columns, weights = bilinear(cells, face.columns, face.rows)
        patches = face.first_patch + rows * face.columns + columns
        rho = scene.reflectance[patches]
        # A black patch's radiosity tells nothing of the light it gets: its neighbours speak for it.
        weights = np.where(rho > 0, weights, 0.0)
        weights /= np.maximum(weights.sum(axis=1, keepdims=True), np.finfo(float).tiny)
        weights = weights * reflectance[pixels, None] / np.where(rho > 0, rho, 1.0)
        pieces.append(_csr(weights.ravel(), np.repeat(pixels, 4), patches.ravel(), shape))
    return csr_array(sum(pieces[1:], start=pieces[0]))
