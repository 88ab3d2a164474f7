"""A reference model of interreflection between projector, camera and the surfaces of a room.

Arrays in, arrays out: no device, no file, no terminal. Lengths are in metres, light is linear, patches are diffuse. A
picture for a room that lights itself takes a few lines:

>>> import numpy as np
>>> import sim
>>> room = sim.paper_room(patch_size_m=0.8)
>>> lens = sim.Lens.from_horizontal_field_of_view(32, 24, 100.0)
>>> pose = sim.Pose.look_at((1.2, 1.2, 1.2), (1.0, 1.0, 0.0))
>>> transport = sim.coaxial_transport(room, sim.form_factors(room), lens, pose)
>>> target = np.full(lens.n_pixels, 0.25)
>>> uncompensated = sim.compensate("none", transport, target, gain=1.0)
>>> compensated = sim.compensate("bounded", transport, target)
>>> compensated.residual_rms < 0.01 * uncompensated.residual_rms
True

What is behind each name: ``help(sim.compensate)`` and so on; all strategies: ``sim.STRATEGIES``.
"""

from __future__ import annotations

from importlib import import_module
from importlib.metadata import version as _version
from typing import Any

__version__ = _version("procam-rig")

_HOME_OF = {
    "Scene": "sim.geometry.scene",
    "Mesh": "sim.geometry.mesh",
    "Lens": "sim.geometry.optics",
    "Pose": "sim.geometry.optics",
    "room": "sim.scenes.gridded",
    "paper_room": "sim.scenes.gridded",
    "room_with_box": "sim.scenes.gridded",
    "FormFactors": "sim.form_factors.factors",
    "form_factors": "sim.form_factors.factors",
    "compressed_form_factors": "sim.form_factors.compressed",
    "Radiosity": "sim.light.radiosity",
    "LightTransport": "sim.light.transport",
    "ColourTransport": "sim.light.colour",
    "Gloss": "sim.light.gloss.material",
    "GlossyTransport": "sim.light.gloss.transport",
    "glossy_transport": "sim.light.gloss.transport_of_scene",
    "coaxial_transport": "sim.light.transport_of_scene",
    "physical_transport": "sim.light.transport_of_scene",
    "simulate_image": "sim.picture.image",
    "STRATEGIES": "sim.compensation",
    "Strategy": "sim.compensation",
    "Compensation": "sim.compensation",
    "compensate": "sim.compensation",
    "plan": "sim.planning.plan",
    "simulate": "sim.planning.simulation",
    "frame_model": "sim.frame.model",
    "FrameCompensator": "sim.frame.compensator",
    "SimulationError": "sim.errors",
}
"""Where each public name is defined; it is imported when it is first asked for."""

__all__ = list(_HOME_OF)  # for type checkers and editors: __init__.pyi

# The function has the name of a room, and the import system would put that in its place later. Inside the rooms:
# ``from sim.form_factors import …``.
form_factors = import_module("sim.form_factors.factors").form_factors


def __getattr__(name: str) -> Any:
    if name not in _HOME_OF:
        raise AttributeError(f"module 'sim' has no attribute {name!r}; there are {', '.join(__all__)}")
    value = getattr(import_module(_HOME_OF[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
