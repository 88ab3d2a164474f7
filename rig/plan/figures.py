"""Figures of a plan's page: the room from above, and its light in space."""

from __future__ import annotations

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from numpy.typing import NDArray

from rig.plan.compute import ComputedPlan
from rig.plan.light import LitRoom
from rig.plan.measures import white_of_patches
from rig.plan.people import meets_person, people_of
from rig.plan.projectors.view import ProjectorView
from rig.report.figures import style
from rig.report.pictures import png_figure
from sim.geometry.optics import Pose, rays_at
from sim.geometry.rays import trace
from sim.geometry.surface import Surface

FloatArray = NDArray[np.float64]

_INK, _SOFT, _PROJECTOR, _VIEWER, _PERSON = "#1d2330", "#5d6678", "#c4561c", "#2557a7", "#7a4fb0"
_PROJECTORS = _PROJECTOR, "#1f8a70", "#a3297a", "#8a6d00"
"""The first four of several, then from the start."""
LIGHT = "inferno"
ELEVATION_DEG = 27.0
_RIM = 24
"""Points along each side of the picture's outline."""


def plan_view(computed: ComputedPlan) -> str:
    """Return the room from above: walls, pictures, projectors, viewers, people and their shadows."""
    lit, request = computed.lit, computed.request
    figure = Figure(figsize=(7.4, 6.4))
    axes = figure.add_subplot()
    _outline(axes, lit.room.surface)
    for view in lit.views:
        _projector_from_above(axes, computed, view)
    for person in people_of(request, lit):
        axes.add_patch(Circle(person.at_m, person.radius_m, color=_PERSON, alpha=0.5, lw=0))
        axes.annotate(
            person.name,
            person.at_m,
            xytext=(0, -16),
            textcoords="offset points",
            ha="center",
            fontsize=8,
            color=_PERSON,
        )
    for viewer in request.viewer:
        axes.plot(*viewer.eye_m[:2], "o", color=_VIEWER, ms=6)
        axes.annotate(
            viewer.name, viewer.eye_m[:2], xytext=(6, 6), textcoords="offset points", fontsize=8, color=_VIEWER
        )
    _surface_names(axes, lit)
    axes.set_aspect("equal")
    axes.margins(0.06)
    axes.legend(fontsize=8, frameon=False, loc="upper center", bbox_to_anchor=(0.5, 1.09), ncols=2)
    style(axes, "x, m", "y, m")
    return png_figure(figure)


def _projector_from_above(axes: Axes, computed: ComputedPlan, view: ProjectorView) -> None:
    """Draw a projector, the edge of its picture, and where its pixels end."""
    rim, lens, colour = _rim_points(view), view.pose.position_m, colour_of(computed.lit, view)
    _picture_dots(axes, computed, view, colour)
    which = "" if len(computed.lit.views) == 1 else f" {view.numbers.name}"
    edge = "edge of the picture" if not which else None
    axes.plot(*np.vstack([rim, rim[:1]])[:, :2].T, color=colour, lw=0.8, label=edge)
    for corner in rim[::_RIM]:
        axes.plot([lens[0], corner[0]], [lens[1], corner[1]], color=colour, lw=0.7, ls="--")
    axes.plot(*lens[:2], "s", color=colour, ms=8, label=f"projector{which}, {lens[2]:.2f} m up")


def _picture_dots(axes: Axes, computed: ComputedPlan, view: ProjectorView, colour: str) -> None:
    """Draw where some of a picture's pixels end, and what people keep from there, violet."""
    kept = view.lit & (np.arange(view.lens.n_pixels) % 7 == 0)
    points = view.points_m
    axes.plot(*points[kept][:, :2].T, ".", color=colour, ms=2, alpha=0.25, mew=0)
    for person in people_of(computed.request, computed.lit):
        shadow = kept & meets_person(view, person, computed.lit.floor_m)[1]
        axes.plot(*points[shadow][:, :2].T, ".", color=_PERSON, ms=2.4, mew=0)


def colour_of(lit: LitRoom, view: ProjectorView) -> str:
    """Return the colour of a projector in figures."""
    return _PROJECTORS[lit.views.index(view) % len(_PROJECTORS)]


def light_view(computed: ComputedPlan) -> str:
    """Return the luminance of white on all surfaces, from above and from below, from behind the first projector."""
    lit = computed.lit
    white = white_of_patches(lit)
    figure = Figure(figsize=(12.4, 5.2))
    scale = Normalize(0.0, float(white.max()))
    views = []
    for k, (title, elevation) in enumerate((("from above", ELEVATION_DEG), ("from below", -ELEVATION_DEG))):
        axes = figure.add_subplot(1, 2, k + 1, projection="3d")
        _draw_light(axes, computed, colormaps[LIGHT](scale(white)), elevation)
        axes.set_title(title, fontsize=10, color=_SOFT)
        views.append(axes)
    bar = figure.colorbar(ScalarMappable(scale, LIGHT), ax=views, shrink=0.75, pad=0.02)
    bar.set_label("luminance of white, room light included, cd/m²", color=_SOFT)
    return png_figure(figure)


def _draw_light(axes: Axes3D, computed: ComputedPlan, colours: FloatArray, elevation_deg: float) -> None:
    lit = computed.lit
    surface = lit.room.surface
    facing = draw_patches(axes, surface, colours, (elevation_deg, azimuth_behind(lit.views[0].pose)))
    for view in lit.views:
        lens, rim = view.pose.position_m, _rim_points(view)
        axes.plot(*np.vstack([rim, rim[:1]]).T, color="#35c0ff", lw=1.3, zorder=9)
        for corner in rim[::_RIM]:
            axes.plot(*np.stack([lens, corner]).T, color="#35c0ff", lw=0.7, ls="--", zorder=9)
        axes.scatter(*lens, color=colour_of(lit, view), s=42, marker="s", zorder=11, depthshade=False)
    for person in people_of(computed.request, computed.lit):
        foot = np.array([*person.at_m, lit.floor_m])
        axes.plot(
            *np.stack([foot, foot + np.array([0.0, 0.0, person.height_m])]).T, color=_PERSON, lw=5, alpha=0.8, zorder=10
        )
    for viewer in computed.request.viewer:
        axes.scatter(*viewer.eye_m, color=_VIEWER, s=30, zorder=11, depthshade=False)
    _names_in_space(axes, lit, facing)


def draw_patches(
    axes: Axes3D, surface: Surface, colours: FloatArray, view_deg: tuple[float, float]
) -> NDArray[np.bool_]:
    """Draw the patches of a surface that face a viewer; those that turn their back would hide the room.

    Parameters
    ----------
    axes
        Of a figure in space.
    surface
        P patches.
    colours : (P, 4) array
        Red, green, blue and opacity of each.
    view_deg
        Elevation and azimuth of the viewer. [degrees]

    Returns
    -------
    (P,) bool array
        Those that were drawn.
    """
    elevation_deg, azimuth_deg = view_deg
    facing = surface.normals @ _direction(azimuth_deg, elevation_deg) > 0
    axes.add_collection3d(
        Poly3DCollection(surface.vertices[facing], facecolors=colours[facing], edgecolors="#ffffff30", linewidths=0.3)
    )
    low, high = surface.vertices.min(axis=(0, 1)), surface.vertices.max(axis=(0, 1))
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set_box_aspect(np.maximum(high - low, 1e-3), zoom=1.15)
    axes.view_init(elev=elevation_deg, azim=azimuth_deg)
    axes.set_axis_off()
    return np.asarray(facing)


def _names_in_space(axes: Axes3D, lit: LitRoom, facing: NDArray[np.bool_]) -> None:
    names, of = lit.room.shape.names, lit.room.shape.surface_of
    if len(names) > 12:
        return
    for k, name in enumerate(names):
        own = (of == k) & facing
        if own.any():
            middle = lit.room.surface.vertices[own].mean(axis=(0, 1))
            axes.text(*middle, name, color="white", fontsize=10, weight="bold", ha="center", va="center", zorder=12)


def azimuth_behind(pose: Pose) -> float:
    """Return where a viewer stands behind a projector, a little aside, so that no wall is seen edge on. [degrees]."""
    ahead = pose.rotation[2]
    return float(np.degrees(np.arctan2(-ahead[1], -ahead[0]))) + 12.0


def _direction(azimuth_deg: float, elevation_deg: float) -> FloatArray:
    a, e = np.radians(azimuth_deg), np.radians(elevation_deg)
    return np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])


def _rim_points(view: ProjectorView) -> FloatArray:
    """(4 * _RIM, 3) where the picture's edge meets the room; rays that meet nothing end 3 m away."""
    right, low = view.lens.width_px - 0.5, view.lens.height_px - 0.5
    corners = np.array([[-0.5, -0.5], [right, -0.5], [right, low], [-0.5, low]])
    along = np.arange(_RIM)[:, None] / _RIM
    ends = zip(corners, np.roll(corners, -1, axis=0), strict=True)
    edge = np.concatenate([a + along * (b - a) for a, b in ends])
    rays = rays_at(view.lens, view.pose, edge)
    hits = trace(view.surface, view.pose.position_m, rays)
    reach = np.where(np.isfinite(hits.distance), hits.distance, 3.0)
    return np.asarray(view.pose.position_m + reach[:, None] * rays)


def _outline(axes: Axes, surface: Surface) -> None:
    """Draw the lowest flat floor grey, and all that stands in the room darker."""
    up = surface.normals[:, 2] > 0.5
    floor_m = float(surface.vertices[:, :, 2].min())
    flat = surface.vertices[up]
    for above, colour in ((False, "#eef0f4"), (True, "#9aa5b1")):
        chosen = (flat[:, :, 2].mean(axis=1) > floor_m + 0.01) == above
        axes.add_collection(PolyCollection(list(flat[chosen][:, :, :2]), facecolors=colour, edgecolors="none"))
    upright = np.abs(surface.normals[:, 2]) < 0.5
    for corners in surface.vertices[upright]:
        a, b = corners[:, :2].min(axis=0), corners[:, :2].max(axis=0)
        axes.plot([a[0], b[0]], [a[1], b[1]], color=_INK, lw=1.6, solid_capstyle="round")


def _surface_names(axes: Axes, lit: LitRoom) -> None:
    """Names of walls and openings beside the walls, inside."""
    shape, surface = lit.room.shape, lit.room.surface
    if len(shape.names) > 16:
        return
    for k, name in enumerate(shape.names):
        own = shape.surface_of == k
        if not shape.upright[k] or not own.any() or np.ptp(surface.normals[own], axis=0).max() > 1e-6:
            continue
        middle, inward = surface.vertices[own].mean(axis=(0, 1)), surface.normals[own][0]
        axes.annotate(
            name,
            middle[:2],
            xytext=tuple(10 * inward[:2]),
            textcoords="offset points",
            ha="left" if inward[0] > 0.5 else "right" if inward[0] < -0.5 else "center",
            va="bottom" if inward[1] > 0.5 else "top" if inward[1] < -0.5 else "center",
            fontsize=9,
            color="#1f8a70" if name in lit.room.openings else _INK,
            weight="bold",
        )
