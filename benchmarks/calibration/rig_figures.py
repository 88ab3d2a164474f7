"""The figures that random rigs are held to, each with its bar: what a calibration that a lab trusts has to keep."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

SIGMAS, SHARE = 4.0, 0.01
"""Silently wrong: within limits, and off by more than so many of its own sigmas, or by this share of the room."""


@dataclass(frozen=True, kw_only=True)
class RigOutcome:
    """What came of one rig."""

    rig: str
    status: int
    processor_s: float
    oracle_processor_s: float = 0.0
    """Of that, for the picture by perfect knowledge."""
    said: str = ""
    """Of a rig that was refused: with what."""
    is_refusal_true: bool | None = None
    """By the simulated world; None where it does not tell, and a person has to."""
    seen: dict[str, Any] | None = None
    """By the simulated world: share that is lit, walls, spots."""
    within_limits: bool = False
    unmet: tuple[str, ...] = ()
    figures: dict[str, float] = field(default_factory=dict)
    sigmas_off: dict[str, float] = field(default_factory=dict)
    """Error of every intrinsic, pose and length by its own sigma."""
    response_sigmas_off: tuple[float, ...] = ()
    share_off: float = 0.0
    """Largest error of a length or a place, by the room's size."""

    @property
    def is_silently_wrong(self) -> bool:
        """Whether it called itself within limits, and was not."""
        scores = [*self.sigmas_off.values(), *self.response_sigmas_off]
        return self.within_limits and (self.share_off > SHARE or max(map(abs, scores), default=0.0) > SIGMAS)

    @property
    def worst(self) -> str:
        """The figure that is off by most of its sigmas, in words."""
        name = max(self.sigmas_off, key=lambda key: abs(self.sigmas_off[key]), default="")
        return f"{name} {self.sigmas_off[name]:+.1f} sigma, lengths {100 * self.share_off:.2f} %" if name else ""


@dataclass(frozen=True, kw_only=True)
class Criterion:
    """A figure of all rigs together, against its bar."""

    name: str
    value: float
    bar: float
    at_least: bool = False

    @property
    def met(self) -> bool | None:
        """None where no rig has the figure."""
        if np.isnan(self.value):
            return None
        return self.value >= self.bar if self.at_least else self.value <= self.bar


def criteria(found: Sequence[RigOutcome]) -> list[Criterion]:
    """Hold all rigs against the bars."""
    ended = [one for one in found if one.figures]

    def quantile(key: str, share: float) -> float:
        values = [abs(one.figures[key]) for one in ended if key in one.figures]
        return float(np.quantile(values, share)) if values else float("nan")

    rms, noise = (np.array([one.figures[key] for one in ended]) for key in ("rmse", "noise_rms"))
    # 1.25 times the noise, or 2.5 grey levels, whichever allows more.
    over = float(np.median(rms / np.maximum(1.25 * noise, 2.5))) if ended else float("nan")
    geometry = np.abs([score for one in ended for score in one.sigmas_off.values()])
    response = np.abs([score for one in ended for score in one.response_sigmas_off])
    untrue = [one for one in found if one.said and one.is_refusal_true is not True]
    return [
        Criterion(name="refusals that are not shown to be true", value=len(untrue), bar=0),
        Criterion(name="bias of direct light, p90, %", value=quantile("direct_bias_percent", 0.9), bar=1.5),
        Criterion(name="bias of global light, p90, %", value=quantile("global_bias_percent", 0.9), bar=1.5),
        Criterion(name="reflectance, lit and seen, median", value=quantile("reflectance", 0.5), bar=0.015),
        Criterion(name="rms over what is allowed, median", value=over, bar=1.0),
        Criterion(name="rms, p90, grey levels", value=quantile("rmse", 0.9), bar=4.0),
        Criterion(name="within 3 sigma, median", value=quantile("within_3_sigma", 0.5), bar=0.93, at_least=True),
        Criterion(name="bounded over perfect knowledge, median", value=quantile("over_oracle", 0.5), bar=1.1),
        Criterion(name="geometry within 3 sigma, share", value=_share(geometry), bar=0.95, at_least=True),
        Criterion(name="response within 3 sigma, share", value=_share(response), bar=0.95, at_least=True),
        Criterion(name="geometry: error over sigma, typical", value=_typical(geometry), bar=0.5, at_least=True),
        Criterion(name="response: error over sigma, typical", value=_typical(response), bar=0.5, at_least=True),
        Criterion(name="within limits and wrong", value=sum(one.is_silently_wrong for one in found), bar=0),
    ]


def _share(scores: np.ndarray[Any, np.dtype[np.float64]]) -> float:
    return float((scores <= 3).mean()) if len(scores) else float("nan")


def _typical(scores: np.ndarray[Any, np.dtype[np.float64]]) -> float:
    """Standard deviation of a normal distribution with the same median of its size."""
    return float(np.median(scores)) / 0.6745 if len(scores) else float("nan")


_COLUMNS = {
    "rms": ("rmse", "7.2f"),
    "noise": ("noise_rms", "7.2f"),
    "3 sigma": ("within_3_sigma", "8.3f"),
    "direct %": ("direct_bias_percent", "9.2f"),
    "global %": ("global_bias_percent", "9.2f"),
    "refl.": ("reflectance", "7.4f"),
    "b/oracle": ("over_oracle", "9.3f"),
    "camera mm": ("camera_position_mm", "10.1f"),
    "focal %": ("focal_percent", "8.2f"),
}


def table(found: Sequence[RigOutcome]) -> str:
    """One line a rig, refusals in their own words, and every figure beside its bar."""
    ended = [one for one in found if one.figures]
    n_within = sum(one.within_limits for one in ended)
    heads = "".join(f"{head:>{int(form.split('.')[0])}}" for head, (_, form) in _COLUMNS.items())
    lines = [
        f"{len(ended)} of {len(found)} ended, {n_within} within their limits; processor seconds a rig: "
        f"{np.mean([one.processor_s for one in found]):.0f}, of these {_oracle_s(ended):.0f} for perfect knowledge",
        f"{'rig':16}{heads}   unmet limits",
    ]
    lines += [_line(one) for one in found]
    lines += [f"  WRONG IN SILENCE: {one.rig}: {one.worst}" for one in found if one.is_silently_wrong]
    lines += ["", f"{'figure':44}{'value':>9}{'bar':>9}"]
    for one in criteria(found):
        bar = f"{'>=' if one.at_least else '<='} {one.bar:g}"
        lines.append(
            f"{one.name:44}{one.value:9.4g}{bar:>9}  {'' if one.met else 'NOT MET' if one.met is False else '-'}"
        )
    return "\n".join(lines)


def _oracle_s(ended: Sequence[RigOutcome]) -> float:
    return float(np.mean([one.oracle_processor_s for one in ended])) if ended else 0.0


def _line(one: RigOutcome) -> str:
    if not one.figures:
        truth = {True: "true", False: "NOT TRUE", None: "truth unknown"}[one.is_refusal_true]
        return f"{one.rig:16} refused, {truth}: {one.said}"
    cells = [
        f"{one.figures[key]:{form}}" if key in one.figures else " " * int(form.split(".")[0])
        for key, form in _COLUMNS.values()
    ]
    return f"{one.rig:16}{''.join(cells)}   {'; '.join(one.unmet) or 'none'}"


def as_json(found: Sequence[RigOutcome]) -> dict[str, Any]:
    """Return all that is known: `figures` with their bars, and `rigs`."""
    figures = [asdict(one) | {"met": one.met} for one in criteria(found)]
    return {"figures": figures, "rigs": [asdict(one) | {"silently_wrong": one.is_silently_wrong} for one in found]}
