"""Charts of the session report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from numpy.typing import NDArray

from calibration.radiometry.response import Response
from rig.files.channels import PRIMARIES
from rig.report.pictures import ERROR_RANGE, png_figure, svg
from rig.stages.scene_model import PosedLens, SceneModel
from sim.geometry.optics import rays_at

FloatArray = NDArray[np.float64]

_INK, _SOFT, _CAMERA, _PROJECTOR = "#1d2330", "#5d6678", "#2557a7", "#c4561c"


def error_scale() -> str:
    """Return the colour scale of the error pictures."""
    figure = Figure(figsize=(4.2, 0.62))
    axes = figure.add_subplot()
    axes.imshow(
        np.linspace(-1, 1, 256)[None, :], aspect="auto", cmap="RdBu_r", extent=(-ERROR_RANGE, ERROR_RANGE, 0, 1)
    )
    axes.set_yticks([])
    axes.set_xticks([-64, -32, 0, 32, 64])
    axes.tick_params(labelsize=8, colors=_SOFT)
    axes.set_xlabel("too dark      error, grey levels      too bright", fontsize=8, color=_SOFT)
    return svg(figure)


def colour_bar(colours: str, low: float, high: float, label: str, gamma: float = 1.0) -> str:
    """Return a colour bar from one value to another; with a gamma, as pictures of light are shown."""
    figure = Figure(figsize=(4.2, 0.62))
    axes = figure.add_subplot()
    shades = np.linspace(0, 1, 256)[None, :] ** (1 / gamma)
    axes.imshow(shades, aspect="auto", cmap=colours, vmin=0, vmax=1, extent=(low, high, 0, 1))
    axes.set_yticks([])
    axes.tick_params(labelsize=8, colors=_SOFT)
    axes.set_xlabel(label, fontsize=8, color=_SOFT)
    return svg(figure)


def response_figure(camera: Response, projector: Sequence[Response]) -> str:
    """Return both devices' response curves, the projector's by channel."""
    figure = Figure(figsize=(10, 3.4))
    for k, (title, responses, unit, colours) in enumerate(
        (
            ("camera", (camera,), "digital numbers above black", (_CAMERA,)),
            ("projector", projector, "code", PRIMARIES[len(projector)] or (_PROJECTOR,)),
        )
    ):
        axes = figure.add_subplot(1, 2, k + 1)
        for response, colour in zip(responses, colours, strict=True):
            axes.plot(response.levels, response.linear, color=colour, lw=2)
        ends = [responses[0].levels[0], responses[0].levels[-1]]
        axes.plot(ends, [responses[0].linear[0], responses[0].linear[-1]], color=_SOFT, lw=0.8, ls=":")
        rms = max(response.rms for response in responses)
        axes.set_title(f"{title}: rms of the fit {100 * rms:.2f} % of full scale", fontsize=10, loc="left")
        style(axes, unit, "linear light")
    figure.subplots_adjust(wspace=0.25)
    return svg(figure)


def timing_figure(seconds: Mapping[str, float]) -> str:
    """Return bars of the seconds by step."""
    figure = Figure(figsize=(10, 0.34 * len(seconds) + 0.7))
    axes = figure.add_subplot()
    names = list(seconds)[::-1]
    values = [seconds[name] for name in names]
    bars = axes.barh(names, values, color=_CAMERA, height=0.62)
    axes.bar_label(bars, labels=[f"{v:.1f} s" for v in values], padding=4, fontsize=9, color=_SOFT)
    axes.set_xlim(0, max(values, default=1.0) * 1.12 + 1e-9)
    style(axes, "wall-clock seconds", "")
    return svg(figure)


def room_figure(scene_model: SceneModel) -> str:
    """Return a plan from above and a view into the room, patches coloured by reflectance."""
    figure = Figure(figsize=(12, 4.6))
    _draw_plan(figure.add_subplot(1, 2, 1), scene_model)
    _draw_view(figure.add_subplot(1, 2, 2, projection="3d"), scene_model)
    return png_figure(figure)


def _draw_plan(axes: Axes, scene_model: SceneModel) -> None:
    low, high = scene_model.scene.vertices.min(axis=(0, 1)), scene_model.scene.vertices.max(axis=(0, 1))
    axes.plot([low[0], high[0], high[0], low[0], low[0]], [low[1], low[1], high[1], high[1], low[1]], color=_INK, lw=2)
    standing = scene_model.scene.region >= len(scene_model.walls)
    plan = list(scene_model.scene.vertices[standing][:, :, :2])
    axes.add_collection(PolyCollection(plan, facecolors="#9aa5b160", edgecolors="#9aa5b1", linewidths=0.5))
    _label_walls(axes, scene_model, (low, high))
    low, high = _extent(scene_model)
    for name, device, colour in (
        ("camera", scene_model.camera, _CAMERA),
        ("projector", scene_model.projector, _PROJECTOR),
    ):
        position = device.pose.position_m
        for x in (-0.5, device.lens.width_px - 0.5):
            ray = _edge_ray(device, x)
            end = position[:2] + ray[:2] * _reach(position, ray, low, high)
            axes.plot([position[0], end[0]], [position[1], end[1]], color=colour, lw=1, ls="--")
        axes.plot(
            *position[:2],
            "o",
            color=colour,
            ms=8,
            label=f"{name} ({position[0]:.2f}, {position[1]:.2f}, {position[2]:.2f}) m",
        )
    axes.set_aspect("equal")
    axes.legend(fontsize=8, frameon=False, loc="upper center", bbox_to_anchor=(0.5, 1.14), ncols=2)
    style(axes, "x, m", "y, m")


def _label_walls(axes: Axes, scene_model: SceneModel, ends: tuple[FloatArray, FloatArray]) -> None:
    """Names of the upright walls that the model has, inside of the outline, as profiles and tables call them."""
    (x0, y0, _), (x1, y1, _) = ends
    x, y = (x0 + x1) / 2, (y0 + y1) / 2
    places = {"x0": (x0, y, "left", "center"), "x1": (x1, y, "right", "center")}
    places |= {"y0": (x, y0, "center", "bottom"), "y1": (x, y1, "center", "top")}
    known = set(scene_model.walls)
    for name, (at_x, at_y, horizontal, vertical) in places.items():
        if name in known:
            axes.annotate(
                name,
                (at_x, at_y),
                xytext=({"right": -5, "left": 5}.get(horizontal, 0), {"top": -5, "bottom": 5}.get(vertical, 0)),
                textcoords="offset points",
                ha=horizontal,
                va=vertical,
                fontsize=10,
                color=_INK,
                weight="bold",
            )


def _extent(scene_model: SceneModel) -> tuple[FloatArray, FloatArray]:
    """(3,) lowest and highest coordinates of walls and devices: before one wall, the devices stand outside of it."""
    devices = [device.pose.position_m for device in (scene_model.camera, scene_model.projector)]
    places = np.concatenate([scene_model.scene.vertices.reshape(-1, 3), np.stack(devices)])
    return places.min(axis=0), places.max(axis=0)


def _edge_ray(device: PosedLens, x_px: float) -> FloatArray:
    middle = np.array([[x_px, (device.lens.height_px - 1) / 2]])
    return np.asarray(rays_at(device.lens, device.pose, middle)[0])


def _reach(position: FloatArray, ray: FloatArray, low: FloatArray, high: FloatArray) -> float:
    """Distance along the plan to the outline."""
    with np.errstate(divide="ignore"):
        ahead = np.where(ray[:2] > 0, high[:2] - position[:2], low[:2] - position[:2]) / ray[:2]
    return float(np.min(ahead))


def _draw_view(axes: Axes3D, scene_model: SceneModel) -> None:
    reflectance, vertices = scene_model.scene.reflectance, scene_model.scene.vertices
    scale = Normalize(float(reflectance.min()), float(reflectance.max()))
    colours = colormaps["viridis"](scale(reflectance))
    # Faces that look towards the viewer would hide the room.
    behind = scene_model.scene.normals @ np.array([-0.75, -0.8, 0.62]) > 0
    behind |= not scene_model.scene.region.any()
    axes.add_collection3d(
        Poly3DCollection(vertices[behind], facecolors=colours[behind], edgecolors="#ffffff60", linewidths=0.4)
    )
    for number, name in enumerate(scene_model.walls):
        own = scene_model.scene.region == number
        if behind[own].all():
            middle = vertices[own].mean(axis=(0, 1))
            axes.text(*middle, name, color="white", fontsize=11, weight="bold", ha="center", va="center", zorder=12)
    for device, colour in ((scene_model.camera, _CAMERA), (scene_model.projector, _PROJECTOR)):
        position, size = device.pose.position_m, 0.9
        corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * (device.lens.width_px - 1, device.lens.height_px - 1)
        ends = position + size * rays_at(device.lens, device.pose, corners.astype(np.float64))
        for a, b in zip(ends, np.roll(ends, -1, axis=0), strict=True):
            axes.plot(*np.stack([position, a]).T, color=colour, lw=1, zorder=10)
            axes.plot(*np.stack([a, b]).T, color=colour, lw=1.4, zorder=10)
        axes.scatter(*position, color=colour, s=36, zorder=11)
    low, high = _extent(scene_model)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set_box_aspect(high - low, zoom=1.12)
    axes.view_init(elev=28, azim=-133)
    axes.set_axis_off()
    bar = axes.get_figure().colorbar(ScalarMappable(scale, "viridis"), ax=axes, shrink=0.7, pad=0.02)
    bar.set_label("reflectance", color=_SOFT)


def style(axes: Axes, x_label: str, y_label: str) -> None:
    """Give axes labels and a quiet look, the same in all charts."""
    axes.set_xlabel(x_label, fontsize=9, color=_SOFT)
    axes.set_ylabel(y_label, fontsize=9, color=_SOFT)
    axes.tick_params(labelsize=8, colors=_SOFT)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
