"""What the reference model refuses, and why."""

from __future__ import annotations


class SimulationError(ValueError):
    """The scene, light or reflectance handed in cannot be simulated; the message says what to try."""
