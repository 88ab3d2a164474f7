"""What a comparison of strategies finds, as frozen records; all errors in grey levels of 255."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from rig.records import JsonObject, Record
from rig.stages.picture_errors import PerceivedErrors
from rig.stages.target import ShownTarget

AFTER = (1, 2, 4, 8)
"""Numbers of captures after which a closed loop's error is told."""


@dataclass(frozen=True, kw_only=True)
class JudgedErrors(PerceivedErrors):
    """How far a picture is from its target, how rich it is in contrast, and how much of that may be noise."""

    contrast: float | None = None
    """None for a picture that has not both black and white."""
    noise_rms: float | None = None
    """Of the camera, part of a measured error; None for a prediction."""
    mean_sigma: float | None = None
    """Standard deviation of a measured mean by the camera's noise."""


@dataclass(frozen=True, kw_only=True)
class StrategyRow(Record):
    """One strategy on one picture; what was not done is None."""

    strategy: str
    predicted: JudgedErrors | None = None
    measured: JudgedErrors | None = None
    clipped_share: float | None = None
    """Share of the steered projector pixels that the range holds back."""
    gain: float | None = None
    """What the strategy scales the target by."""
    seconds: float | None = None
    """To compute the projector image."""
    iterations: int | None = None
    captures: int | None = None
    frames: int | None = None
    notes: Mapping[str, float | str] | None = None

    @property
    def shown(self) -> JudgedErrors:
        """The measured errors, or the predicted ones where nothing was measured."""
        errors = self.measured or self.predicted
        if errors is None:
            raise ValueError(f"{self.strategy}: neither measured nor predicted")
        return errors


@dataclass(frozen=True, kw_only=True)
class ComparedPicture(Record):
    """All strategies on one picture."""

    name: str
    title: str
    rows: tuple[StrategyRow, ...]
    target: ShownTarget | None = None
    """How its file was read; None of the pictures of the paper's configurations, which are codes."""

    @property
    def sentence(self) -> str:
        """What it shows, and how that was read."""
        return self.target.sentence if self.target else self.title

    def row(self, strategy: str) -> StrategyRow:
        """The row of a strategy that was compared."""
        return next(row for row in self.rows if row.strategy == strategy)


@dataclass(frozen=True, kw_only=True)
class OracleRows(Record):
    """Strategies with the true light transport of a simulated world."""

    rows: tuple[StrategyRow, ...]


@dataclass(frozen=True, kw_only=True)
class ClosedLoop(Record):
    """A strategy whose picture was corrected by what was measured, again and again."""

    strategy: str
    rule: str
    damping: float
    captures: tuple[JudgedErrors, ...]
    """Of each capture."""
    best: int
    """Number of the capture that was kept, from 1."""
    stopped: str
    """Why it stopped."""

    @property
    def kept(self) -> JudgedErrors:
        """Errors of the picture that was kept."""
        return self.captures[self.best - 1]

    @property
    def after(self) -> Mapping[int, JudgedErrors]:
        """The best picture's errors after 1, 2, 4, 8 captures, and after all."""
        numbers = sorted({number for number in AFTER if number <= len(self.captures)} | {len(self.captures)})
        return {number: min(self.captures[:number], key=lambda errors: errors.mean) for number in numbers}

    def as_json(self) -> JsonObject:
        """The fields, and ``after``: errors by number of captures."""
        return super().as_json() | {"after": {str(number): errors.as_json() for number, errors in self.after.items()}}


@dataclass(frozen=True, kw_only=True)
class ComparisonResult(Record):
    """Every strategy beside the others: ``rig compare-strategies --json``."""

    pictures: tuple[ComparedPicture, ...]
    loops: tuple[ClosedLoop, ...] = ()
    oracle: tuple[StrategyRow, ...] = ()
    """What knowing the simulated world's light transport would give."""
    ratios: Mapping[str, float]
    warnings: tuple[str, ...]
    """A sentence for each result that is worse than direct light alone."""
    session: str | None = None
    """None: computed for the paper's configurations, without a rig."""
    profile: str | None = None
    target: str | None = None
    noise_rms: float | None = None
    report: str | None = None
    elapsed_s: float | None = None
