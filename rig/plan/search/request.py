"""What a search is asked for: ``[search]`` of ``ROOM.toml``."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from rig.files.toml import Table

Measure = Literal[
    "error", "brightness", "coverage", "contrast", "global_share", "density", "paint_cost", "cost", "unreached"
]
Text = Annotated[str, Field(min_length=1)]
Point = tuple[float, float, float]


class FreeParameter(Table):
    """``[[search.free]]``: a number of the room with its range, or a word with its choices."""

    key: Text
    """Its place in the room file: ``projector.position_m.0``, ``paint.walls``."""
    low: float | None = None
    high: float | None = None
    choices: tuple[int | float | str, ...] = ()


class SearchGoal(Table):
    """``[[search.goal]]``: a number of the result, better when it is smaller (or larger)."""

    measure: Measure
    weight: Annotated[float, Field(gt=0, le=1e6)] = 1.0
    """Beside the other goals, each over its spread."""
    at_least: float | None = None
    at_most: float | None = None
    """Limits: a design that breaks one is worse than any that keeps all."""


class KeepOut(Table):
    """``[[search.keep_out]]``: a box in which the projector must not stand."""

    low_m: Point
    high_m: Point
    name: str = "keep-out"


class SearchTable(Table):
    """``[search]``: what is free, what is wanted, and how long to look."""

    free: Annotated[tuple[FreeParameter, ...], Field(min_length=1)]
    goal: Annotated[tuple[SearchGoal, ...], Field(min_length=1)]
    keep_out: tuple[KeepOut, ...] = ()
    evaluations: Annotated[int, Field(ge=8, le=100_000)] = 200
    strategy: Text = "bounded"
    """Whose error is meant."""
    width_px: Annotated[int, Field(ge=16, le=640)] = 80
    """Of the pictures while it looks."""
