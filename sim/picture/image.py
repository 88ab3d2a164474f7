"""The picture that a camera takes of a scene while a projector lights it, from geometry to pixels.

c = rho cos(theta) p + rho H (eq. 9): direct light by the pixel, the light H that arrives from all patches by the
patch, smoothly between patches, or final_gather at the pixel. No matrix but the form factors is made; to apply the
same transport many times see ``sim.light.transport_of_scene``. Units and conventions are those of that module.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim import _kernel
from sim.arrays import FloatArray, IntArray
from sim.errors import SimulationError
from sim.form_factors import FormFactors
from sim.geometry.interpolation import bilinear
from sim.geometry.optics import Lens, Pose, project, rays_at, solid_angles
from sim.geometry.rays import blocked, device_of, trace, tracer_of
from sim.geometry.scene import Scene
from sim.geometry.surface import Surface
from sim.light.radiosity import Radiosity
from sim.light.transport_of_scene import Convention, EmissionRule
from sim.picture.gather import final_gather
from sim.picture.reconstruction import fans, quadratics

Reconstruction = Literal["patch", "smooth", "gather"]

PARTS_A_PATCH = 100
"""Parts of pixels that should fall on a patch, if all were lit."""


@dataclass(frozen=True, eq=False, kw_only=True)
class SimulatedImage:
    """A picture and what it is made of; radiosity in the convention's unit."""

    camera_image: FloatArray
    """(H, W) direct + indirect."""
    direct: FloatArray
    """(H, W) light reflected once."""
    indirect: FloatArray
    """(H, W) light reflected more than once."""
    emission: FloatArray
    """(P,) E: light of the projector that each patch sends back."""
    radiosity: FloatArray
    """(P,) B: all light that each patch sends back."""
    pixel_patch: NDArray[np.int32]
    """(H, W) the patch that each pixel sees, -1 for none."""
    seconds: Mapping[str, float]
    """Time of each stage: light, solve, reconstruct."""


def simulate_image(
    surface: Surface,
    form_factors: FormFactors,
    lens: Lens,
    pose: Pose,
    *,
    projector_image: ArrayLike,
    convention: Convention = "paper",
    emission: EmissionRule = "area",
    reconstruction: Reconstruction = "smooth",
    subsamples: int | None = None,
    gather_tolerance: float = 1e-3,
    camera_lens: Lens | None = None,
    camera_pose: Pose | None = None,
) -> SimulatedImage:
    """Return the picture that the camera takes: light, solve, reconstruct.

    Parameters
    ----------
    surface : Surface
        A ``Scene`` or a ``Mesh``.
    form_factors : FormFactors
        Of that surface.
    lens, pose
        Of the projector, and of the camera unless it has its own.
    projector_image : (H, W) array
        Linear light, 0 or more.
    convention : {"paper", "physical"}
        Without fall-off, or over r² cos³ gamma.
    emission : {"area", "pixel_mean"}
        The light of each pixel's parts that lands on a patch, over its area; or eq. 5, the mean over the pixels
        that reach the patch, which takes half-lit patches for lit.
    reconstruction : {"smooth", "patch", "gather"}
        Of the indirect light: continuous within each flat region and true to the patches' means; constant a
        patch (eq. 9); or final_gather from all patches at the pixels (slow: 0.1 to 10 s).
    subsamples : int, optional
        ``area``: each pixel is split into subsamples x subsamples parts; from 2 to 8 by itself, so that about a
        hundred parts fall on a patch.
    gather_tolerance : float
        ``gather``: what interpolation between final_gather pixels may cost, as a share.
    camera_lens, camera_pose : optional
        A camera apart from the projector: its direct light is bilinear between projector pixels, and shadowed.

    Returns
    -------
    SimulatedImage

    Raises
    ------
    SimulationError
        For an unknown choice, a picture that does not fit the lens or is negative, or form factors of another
        surface.

    References
    ----------
    Dehos, Zéghers, Sarry, Rousselle and Renaud, Virtual Reality 18(2), 2014; equations 5, 6 and 9.
    """
    picture = _checked(surface, form_factors, lens, projector_image)
    _check_choices(convention, emission, reconstruction, subsamples)
    marks = [time.perf_counter()]
    wanted = int(np.clip(np.ceil(np.sqrt(PARTS_A_PATCH * surface.n_patches / lens.n_pixels)), 2, 8))
    parts = 0 if emission == "pixel_mean" else wanted if subsamples is None else subsamples
    E, seen = _lit(surface, lens, pose, picture=picture, physical=convention == "physical", subsamples=parts)
    if camera_lens is not None or camera_pose is not None:
        camera_lens, camera_pose = camera_lens or lens, camera_pose or pose
        dark = np.zeros(camera_lens.shape)
        _, seen = _lit(surface, camera_lens, camera_pose, picture=dark, physical=False, subsamples=0)
        points = _seen_points(surface, camera_lens, camera_pose)
        direct = _direct_apart(surface, lens, pose, picture=picture, convention=convention, points=points)
        seen = _Seen(direct, seen.patch, seen.place)
    else:
        camera_lens, camera_pose = lens, pose
    marks.append(time.perf_counter())
    B = Radiosity(form_factors, surface.reflectance).solve(E)
    marks.append(time.perf_counter())
    if reconstruction == "gather":
        H = final_gather(surface, B, camera_lens, camera_pose, patch=seen.patch, tolerance=gather_tolerance)
        indirect = np.where(seen.patch >= 0, surface.reflectance[seen.patch], 0.0) * H
    else:
        indirect = _indirect(surface, _received(surface, form_factors, E, B), seen, reconstruction)
    camera_image = seen.direct + indirect
    marks.append(time.perf_counter())
    seconds = dict(zip(("light", "solve", "reconstruct"), np.diff(marks).tolist(), strict=True))
    return SimulatedImage(
        camera_image=camera_image,
        direct=seen.direct,
        indirect=indirect,
        emission=E,
        radiosity=B,
        pixel_patch=seen.patch,
        seconds=seconds,
    )


@dataclass(frozen=True, eq=False)
class _Seen:
    """What the pixels see."""

    direct: FloatArray
    patch: NDArray[np.int32]
    place: FloatArray
    """(H, W, 2) where in its patch: cell coordinates of a gridded face, metres about a mesh patch's centroid."""


def _lit(
    surface: Surface, lens: Lens, pose: Pose, *, picture: FloatArray, physical: bool, subsamples: int
) -> tuple[FloatArray, _Seen]:
    """Emission of the patches, and what the projector's pixels meet (in plain numpy: ``transport_of_scene``)."""
    seen = _Seen(np.empty(lens.shape), np.empty(lens.shape, dtype=np.int32), np.empty((*lens.shape, 2)))
    E = np.empty(surface.n_patches)
    tracer_of(surface).light(
        device_of(lens, pose),
        picture,
        reflectance=np.ascontiguousarray(surface.reflectance),
        areas=np.ascontiguousarray(surface.areas),
        subsamples=subsamples,
        physical=physical,
        direct=seen.direct,
        patch=seen.patch,
        place=seen.place,
        emission=E,
    )
    return E, seen


def _received(surface: Surface, form_factors: FormFactors, E: FloatArray, B: FloatArray) -> FloatArray:
    """(P,) mean irradiance H = F B: from (B - E) / rho, and by the matrix where a patch is too black to tell."""
    rho = surface.reflectance
    dark = rho < 1e-3
    H = (B - E) / np.where(dark, 1.0, rho)
    if dark.any():
        H[dark] = form_factors.apply(B)[dark]
    return np.maximum(H, 0.0)


def _indirect(surface: Surface, H: FloatArray, seen: _Seen, reconstruction: str) -> FloatArray:
    """(H, W) indirect light of the pixels from the patches' mean irradiance."""
    indirect = np.empty(seen.patch.shape)
    rho = surface.reflectance
    if reconstruction == "patch":
        _kernel.shade_constant(seen.patch, rho * H, indirect)
    elif isinstance(surface, Scene):
        coefficients = rho[:, None, None] * quadratics(surface, H)
        _kernel.shade_quadratic(seen.patch, seen.place, np.ascontiguousarray(coefficients), indirect)
    else:
        corners, values = fans(surface, H)
        _kernel.shade_fan(
            seen.patch,
            seen.place,
            corners=corners,
            values=np.ascontiguousarray(rho[:, None] * values),
            indirect=indirect,
        )
    return indirect


@dataclass(frozen=True, eq=False)
class _SeenPoints:
    """Surface points that the pixels of a camera see."""

    shape: tuple[int, int]
    """(H, W) of the camera [px]."""
    pixel: IntArray
    """(N,) flat index of each pixel that sees something."""
    points_m: FloatArray
    """(N, 3) [m]."""
    patch: IntArray
    """(N,) the patch that each point lies on."""


def _seen_points(surface: Surface, lens: Lens, pose: Pose) -> _SeenPoints:
    rays = rays_at(lens, pose, lens.pixel_grid())
    hits = trace(surface, pose.position_m, rays)
    pixels = np.flatnonzero(hits.patch >= 0)
    points = pose.position_m + hits.distance[pixels, None] * rays[pixels]
    return _SeenPoints(lens.shape, pixels, points, hits.patch[pixels])


def _direct_apart(
    surface: Surface, lens: Lens, pose: Pose, *, picture: FloatArray, convention: Convention, points: _SeenPoints
) -> FloatArray:
    """(H, W) direct light that a camera apart from the projector sees, shadowed by rays."""
    xy = project(lens, pose, points.points_m)
    with np.errstate(invalid="ignore"):
        inside = ((xy > -0.5) & (xy < np.array([lens.width_px, lens.height_px]) - 0.5)).all(axis=1)
    pixels, patch, xy = points.pixel[inside], points.patch[inside], xy[inside]
    way = points.points_m[inside] - pose.position_m
    distance = np.linalg.norm(way, axis=1)
    cosine = -np.einsum("nk,nk->n", way, surface.normals[patch]) / distance
    # The point is on the surface: a ray that ends just before it is not stopped by it.
    end_m = points.points_m[inside] - 1e-6 * way
    shadow = (cosine <= 0) | blocked(surface, np.broadcast_to(pose.position_m, end_m.shape), end_m)
    if convention == "physical":
        cosine = cosine / (lens.focal_px[0] * lens.focal_px[1] * solid_angles(lens, xy) * distance**2)
    rows, columns, weights = bilinear(xy, lens.width_px, lens.height_px)
    light = (weights * picture[rows, columns]).sum(axis=1)
    direct = np.zeros(points.shape[0] * points.shape[1])
    direct[pixels] = np.where(shadow, 0.0, surface.reflectance[patch] * cosine * light)
    return direct.reshape(points.shape)


def _checked(surface: Surface, form_factors: FormFactors, lens: Lens, projector_image: ArrayLike) -> FloatArray:
    picture = np.ascontiguousarray(projector_image, dtype=np.float64)
    if picture.shape != lens.shape:
        raise SimulationError(
            f"projector image of shape {picture.shape} for a lens of {lens.shape} pixels; give the lens's own size"
        )
    if not (np.isfinite(picture).all() and picture.min() >= 0):
        raise SimulationError(f"projector image from {picture.min():.4g} to {picture.max():.4g}; 0 or more, and finite")
    if len(form_factors.areas) != surface.n_patches:
        raise SimulationError(
            f"form factors of {len(form_factors.areas)} patches for {surface.name} of {surface.n_patches}; "
            "compute them from the same surface"
        )
    return picture


def _check_choices(convention: str, emission: str, reconstruction: str, subsamples: int | None) -> None:
    for name, value, known in (
        ("convention", convention, ("paper", "physical")),
        ("emission rule", emission, ("area", "pixel_mean")),
        ("reconstruction", reconstruction, ("smooth", "patch", "gather")),
    ):
        if value not in known:
            raise SimulationError(f"unknown {name} {value!r}; there are {', '.join(known)}")
    if subsamples is not None and subsamples < 1:
        raise SimulationError(f"{subsamples} subsamples a pixel; at least 1")
