"""Points of a study, what is known of each, and what a sweep found, as records."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rig.records import JsonObject, Record

PointStatus = Literal["done", "refused", "killed"]
Figure = float | int | str | bool | None
_ID_DIGITS = 20
"""Of SHA-256: 80 bits, so that a million points share no name."""


@dataclass(frozen=True, kw_only=True)
class StudyPoint:
    """One point of a study: its complete inputs, and its name, the hash of these and of the version."""

    id: str
    inputs: JsonObject


@dataclass(frozen=True, kw_only=True, eq=False)
class Evaluated:
    """What a subject answers at a point."""

    figures: Mapping[str, Figure]
    arrays: Mapping[str, NDArray[np.generic]] = field(default_factory=dict)
    """Pictures and maps, kept where the study wants them."""


@dataclass(frozen=True, kw_only=True)
class PointLine(Record):
    """What is known of a point: one line of ``points.jsonl``."""

    id: str
    subject: str
    version: str
    inputs: JsonObject
    status: PointStatus
    """refused: it cannot be computed, and ``error`` says why; killed: its workers died as often as it was tried."""
    figures: Mapping[str, Figure] = field(default_factory=dict)
    error: str | None = None
    tries: int = 1
    seconds: float = 0.0
    """Of processor time."""
    arrays: str | None = None
    """File beside, relative to the folder."""


@dataclass(frozen=True, kw_only=True)
class FigureSpread(Record):
    """How a figure is distributed over the points."""

    figure: str
    points: int
    """That have it."""
    min: float
    tenth: float
    median: float
    ninetieth: float
    max: float


@dataclass(frozen=True, kw_only=True)
class SweepResult(Record):
    """What a sweep found, and where it lies: ``rig sweep --json``."""

    title: str
    subject: str
    version: str
    folder: str
    points: int
    """Of the study."""
    computed_now: int
    computed_before: int
    refused: int
    killed: int
    left: int
    """Points of the study that are not done yet; 0 unless the sweep was limited."""
    others: int
    """Points in the folder that are not of this study or version; they stay."""
    spreads: tuple[FigureSpread, ...] = ()
    failures: tuple[PointLine, ...] = ()
    """The first of them, with their inputs."""
    warnings: tuple[str, ...] = ()
    report: str | None = None
    table: str | None = None
    elapsed_s: float = 0.0


def point_id(subject: str, version: str, inputs: JsonObject) -> str:
    """Return the name of a point: a hash of what it is asked and of the version that answers."""
    text = json.dumps([subject, version, inputs], sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()[:_ID_DIGITS]
