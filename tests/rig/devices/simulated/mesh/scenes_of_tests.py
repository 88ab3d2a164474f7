"""Small scenes and the settings to look at them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.devices.simulated.mesh.scene import TriangleScene
from rig.devices.simulated.settings import SimulationSettings
from rig.devices.simulated.worlds.shapes import block, room

FloatArray = NDArray[np.float64]

CAMERA: tuple[int, int] = (48, 64)
PROJECTOR: tuple[int, int] = (36, 48)


def scene_of(
    parts: dict[str, FloatArray], reflectance: float = 0.5, **materials: tuple[float, float, float]
) -> TriangleScene:
    """A scene of named parts; `materials` has (reflectance, gloss, roughness) of some of them."""
    counts = [len(part) for part in parts.values()]
    rows = np.array([materials.get(name, (reflectance, 0.0, 0.3)) for name in parts])
    each = np.repeat(rows, counts, axis=0)
    return TriangleScene(
        name="test",
        triangles_m=np.concatenate(list(parts.values())),
        material=np.repeat(np.arange(len(parts)), counts),
        materials=tuple(parts),
        reflectance=np.repeat(each[:, :1], 3, axis=1),
        gloss=each[:, 1].copy(),
        roughness=each[:, 2].copy(),
    )


def walls(size_m: tuple[float, float, float] = (3.0, 3.0, 2.4)) -> dict[str, FloatArray]:
    return dict(room(size_m))


def with_box(size_m: tuple[float, float, float] = (3.0, 3.0, 2.4)) -> dict[str, FloatArray]:
    """A room with a box in its middle."""
    return {**walls(size_m), "box": block((1.8, 1.9), (0.5, 0.4, 0.6), turn_deg=20.0)}


def settings_of(**changes: Any) -> SimulationSettings:
    """A camera and a projector, pinholes, that look into the far corner of the room."""
    camera = {
        "name": "camera",
        "position_m": (0.4, 0.9, 1.4),
        "look_at_m": (2.6, 2.4, 0.9),
        "focal_px": 40.0,
        "principal_point_px": (31.5, 23.5),
        "sensitivity_e_per_s": 1e6,
    }
    projector = {
        "name": "projector",
        "position_m": (0.8, 0.4, 1.2),
        "look_at_m": (2.6, 2.6, 1.0),
        "focal_px": 32.0,
        "principal_point_px": (23.5, 17.5),
    }
    table: dict[str, Any] = {
        "scene": "test.ply",
        "cell_size_m": 0.2,
        "rays": 256,
        "camera": (camera | changes.pop("camera", {}),),
        "projector": (projector | changes.pop("projector", {}),),
    }
    return SimulationSettings.model_validate(table | changes)
