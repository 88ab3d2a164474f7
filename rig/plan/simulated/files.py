"""Files of a simulation: brightness by surface (CSV), a mesh with light (PLY and GLB), pictures, and a page.

Light is in shares of white, as all of ``rig simulate``: irradiance 1 on a white surface is 1.
"""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from matplotlib import colormaps
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rig.errors import UsageError
from rig.files.atomic import write_bytes
from rig.files.pictures import write_png
from rig.files.ply_mesh import write_ply_mesh
from rig.offline.simulate import PlannedSimulation, SimulationRequest
from rig.plan.figures import ELEVATION_DEG, LIGHT, azimuth_behind, draw_patches
from rig.report import pictures
from rig.report.pictures import EmbeddedPicture, png_figure
from rig.report.render import Headline, TextTable, rendered
from sim.geometry.adaptive_patches import AdaptivePatches
from sim.geometry.optics import rays_at
from sim.geometry.rays import trace
from sim.geometry.scene import Scene
from sim.light.lighting import PlacedProjector, standard_projector
from sim.planning.simulation import Simulation
from sim.scenes.catalogue import SURFACES

FloatArray = NDArray[np.float64]

HEAD = ("surface", "area_m2", "direct", "indirect", "brightness", "darkest", "brightest", "global_share")
"""Columns of the CSV; light in shares of white, brightness is direct and indirect light times reflectance."""
MOST_NAMED = 60
"""Surfaces that are told apart; a mesh of more is told by floor, ceiling and walls."""


@dataclass(frozen=True, kw_only=True)
class SimulatedPage:
    """What the page's template shows."""

    title: str
    subtitle: str
    met: bool
    word: str
    verdict: str
    headline: tuple[Headline, ...]
    view: EmbeddedPicture
    space: str
    table: TextTable
    reasons: tuple[str, ...]


@dataclass(frozen=True, eq=False, kw_only=True)
class _BrightRoom:
    """Patches with the light of the brightest colour."""

    cells: AdaptivePatches
    direct: FloatArray
    """(P,) irradiance from the lamp."""
    indirect: FloatArray
    """(P,) irradiance from other patches."""
    brightness: FloatArray
    """(P,) radiosity."""


def write_simulation(
    folder: Path, request: SimulationRequest, planned: PlannedSimulation, light: Simulation
) -> tuple[Path, ...]:
    """Write the files of a simulation and return their paths.

    Parameters
    ----------
    folder
        Made if it does not exist.
    request
        What was asked for.
    planned, light
        What was planned, and the light of its patches; of several colours the brightest.

    Raises
    ------
    UsageError
        If the folder cannot be made.
    SessionError
        If the disk refuses.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"{folder}: no folder for files ({error.strerror}); give another") from error
    rho = np.maximum(light.reflectance[:, 0], 1e-12)
    room = _BrightRoom(
        cells=light.cells,
        direct=np.where(light.reflectance[:, 0] > 0, light.E[:, 0] / rho, 0.0),
        indirect=light.irradiance[:, 0],
        brightness=light.B[:, 0],
    )
    rows = brightness_rows(room, request.scene)
    names = ("brightness.csv", "light.ply", "light.glb", "view.png", "simulation.html")
    table, ply, glb, view, page = (folder / name for name in names)
    write_bytes(table, _csv_of(rows))
    _write_meshes(room, ply, glb)
    levels = _view(room, planned, request.projector)
    write_png(view, pictures.photograph(levels))
    write_bytes(page, rendered("plan/simulated/simulated.html", _page(room, request, planned, (levels, rows))).encode())
    return table, ply, glb, view, page


def brightness_rows(room: _BrightRoom, scene: str) -> list[tuple[str, ...]]:
    """Return a row for each surface, cells as in ``HEAD``."""
    rows = []
    names, of = _named(room.cells, scene)
    for k, name in enumerate(names):
        own = of == k
        area = room.cells.areas[own]
        direct, indirect, bright = (
            float((values[own] * area).sum() / area.sum()) for values in (room.direct, room.indirect, room.brightness)
        )
        numbers = (float(area.sum()), direct, indirect, bright, *_ends(room.brightness[own]))
        share = indirect / max(direct + indirect, 1e-12)
        rows.append((name, *(f"{value:.6g}" for value in (*numbers, share))))
    return rows


def _ends(values: FloatArray) -> tuple[float, float]:
    return float(values.min()), float(values.max())


def _named(cells: AdaptivePatches, scene: str) -> tuple[list[str], NDArray[np.intp]]:
    """Names of the surfaces, and (P,) that of each patch."""
    built = SURFACES[scene].build() if scene in SURFACES else None
    if isinstance(built, Scene):
        return [face.name for face in built.faces], cells.region
    regions, of = np.unique(cells.region, return_inverse=True)
    if len(regions) <= MOST_NAMED:
        return [f"region {number}" for number in regions], of
    up = cells.normals[:, 2]
    there, of = np.unique(np.where(up > 0.5, 0, np.where(up < -0.5, 1, 2)), return_inverse=True)
    return [("floor", "ceiling", "walls")[k] for k in there], of


def _csv_of(rows: list[tuple[str, ...]]) -> bytes:
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(HEAD)
    writer.writerows(rows)
    return stream.getvalue().encode()


def _write_meshes(room: _BrightRoom, ply: Path, glb: Path) -> None:
    """The patches as triangles, each with its brightness as a grey; the brightest is white, gamma 2.2."""
    brightest = max(float(room.brightness.max()), 1e-12)
    grey = np.rint(255 * np.clip(room.brightness / brightest, 0, 1) ** (1 / 2.2)).astype(np.uint8)
    corners = room.cells.vertices
    second = ~room.cells.triangular
    triangles = np.concatenate([corners[:, [0, 1, 2]], corners[second][:, [0, 2, 3]]])
    colours = np.repeat(np.concatenate([grey, grey[second]])[:, None], 3, axis=1)
    write_ply_mesh(ply, triangles, colours, [f"white is a brightness of {brightest:.6g}; gamma 2.2"])
    mesh = trimesh.Trimesh(
        triangles.reshape(-1, 3),
        np.arange(3 * len(triangles)).reshape(-1, 3),
        vertex_colors=np.repeat(colours, 3, axis=0),
        process=False,
    )
    exported = mesh.export(file_type="glb")
    write_bytes(glb, exported if isinstance(exported, bytes) else str(exported).encode())


def _view(room: _BrightRoom, planned: PlannedSimulation, placed: PlacedProjector | None) -> FloatArray:
    """(H, W) brightness that one sees from the projector, or from the standard one's place; 255 = the brightest."""
    seat = placed or standard_projector(room.cells)
    lens, pose = seat.lens, seat.pose
    rays = rays_at(lens, pose, lens.pixel_grid())
    hits = trace(room.cells, pose.position_m, rays)
    seen = hits.patch >= 0
    patch = hits.patch[seen]
    points = pose.position_m + hits.distance[seen, None] * rays[seen]
    light = planned.plan.light.irradiance(points, room.cells.normals[patch], room.cells.region[patch])
    rho = np.divide(
        room.brightness[patch],
        room.direct[patch] + room.indirect[patch],
        out=np.zeros(len(patch)),
        where=room.brightness[patch] > 0,
    )
    values = np.zeros(lens.n_pixels)
    values[seen] = rho * (light + room.indirect[patch])
    return 255 * values.reshape(lens.shape) / max(float(values.max()), 1e-12)


def _page(
    room: _BrightRoom,
    request: SimulationRequest,
    planned: PlannedSimulation,
    shown: tuple[FloatArray, list[tuple[str, ...]]],
) -> SimulatedPage:
    levels, rows = shown
    areas = room.cells.areas
    direct, indirect = (float((values * areas).sum() / areas.sum()) for values in (room.direct, room.indirect))
    return SimulatedPage(
        title=f"Light of {Path(request.scene).name}",
        subtitle=f"{planned.plan.light.description}; {room.cells.n_patches} patches; light in shares of white.",
        met=True,
        word=f"Within {planned.plan.tolerance_percent:.2g} %",
        verdict=f"of white is asked for, {planned.plan.error_percent:.2g} % expected",
        headline=(
            Headline(f"{direct:.3f}", "of white", "direct light, mean over the surface"),
            Headline(f"{indirect:.3f}", "of white", "from other surfaces"),
            Headline(f"{100 * indirect / max(direct + indirect, 1e-12):.0f}", "%", "of all light is global"),
        ),
        view=pictures.picture(pictures.photograph(levels), "What is seen from the projector"),
        space=_space(room, request.projector or standard_projector(room.cells)),
        table=TextTable(HEAD, rows),
        reasons=planned.plan.reasons,
    )


def _space(room: _BrightRoom, seat: PlacedProjector) -> str:
    figure = Figure(figsize=(12.4, 5.2))
    scale = Normalize(0.0, max(float(room.brightness.max()), 1e-12))
    views = []
    for k, elevation in enumerate((ELEVATION_DEG, -ELEVATION_DEG)):
        axes = figure.add_subplot(1, 2, k + 1, projection="3d")
        colours = colormaps[LIGHT](scale(room.brightness))
        draw_patches(axes, room.cells, colours, (elevation, azimuth_behind(seat.pose)))
        views.append(axes)
    figure.colorbar(ScalarMappable(scale, LIGHT), ax=views, shrink=0.75, pad=0.02).set_label("brightness, 1 = white")
    return png_figure(figure)
