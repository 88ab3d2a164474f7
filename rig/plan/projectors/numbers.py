"""The projector of a plan in numbers: what the room file says, else what its model's public documents say."""

from __future__ import annotations

import math
from dataclasses import dataclass

from rig.errors import ProfileError, UsageError
from rig.plan.request import PlannedProjector
from rig.profile.hardware_facts import Fact, ProjectorFacts, by_model, known_projectors
from rig.records import Record
from sim.geometry.optics import Lens

THROW = 0.1, 20.0
"""Throw ratios that lenses have; mirrors reach 0.19, long lenses 15."""
MOST_SHIFT = 2.0
"""Of the picture's size; mirrors of ultra-short throw reach 1."""
SHAPE = 0.2, 6.0
"""Width over height of pictures that projectors make: 16:9 is 1.8, two of them side by side 3.6."""
USUAL_CONTRAST = 1000.0
"""Full on to full off where nobody has measured one: a guess, and said to be one."""


@dataclass(frozen=True, kw_only=True)
class ProjectorNumbers(Record):
    """What a plan counts with."""

    name: str
    throw_ratio: float
    lens_shift: tuple[float, float]
    lumens: float
    contrast: float
    width_px: int
    height_px: int
    hfov_deg: float
    """Angle between the picture's left and right edge, without shift. [degrees]"""
    cost: float
    said: tuple[str, ...]
    """Where each number that the room file does not give comes from."""

    def lens(self, width_px: int) -> Lens:
        """Return the lens with the picture in so many columns [px]."""
        height_px = max(1, round(width_px * self.height_px / self.width_px))
        focal_px = self.throw_ratio * width_px
        right, up = self.lens_shift
        # A picture shifted to the right has its axis left of its middle; image rows count downwards.
        principal = ((width_px - 1) / 2 - right * width_px, (height_px - 1) / 2 + up * height_px)
        return Lens(width_px=width_px, height_px=height_px, focal_px=(focal_px, focal_px), principal_point_px=principal)


def projector_numbers(asked: PlannedProjector, place: str = "projector") -> ProjectorNumbers:
    """Return the numbers of a projector.

    Parameters
    ----------
    asked
        Of the room file.
    place
        What messages call its table: ``projector``, or ``projector.left`` of several.

    Raises
    ------
    UsageError
        For a number that nobody gives, an unknown model, or a lens that cannot be.
    """
    facts, name = ProjectorFacts(), place.removeprefix("projector.")
    if asked.model is not None:
        try:
            file = by_model(asked.model, known_projectors())
        except ProfileError as error:
            raise UsageError(f"{place}.model: {error}") from error
        facts, name = file.facts, f"{file.maker} {file.model}"
    said: list[str] = []
    try:
        throw_ratio = asked.throw_ratio or _throw_ratio(facts, name, said)
        width_px = asked.width_px or _cited("width_px", facts.width_px, name, said)
        height_px = asked.height_px or _cited("height_px", facts.height_px, name, said)
        lumens = asked.lumens or _lumens(facts, name, said)
    except _NobodySays as error:
        whose = "no model is named" if asked.model is None else f"no document that we know says it of {name}"
        raise UsageError(f"{place}.{error.key}: missing, and {whose}; give {error.what}") from error
    contrast = asked.contrast or _contrast(facts, name, said)
    _check_lens(place, throw_ratio, asked.lens_shift)
    if not SHAPE[0] <= width_px / height_px <= SHAPE[1]:
        raise UsageError(
            f"{place}.width_px, height_px: a picture of {width_px} x {height_px} pixels is {width_px / height_px:.3g} "
            f"times as wide as high; projectors have {SHAPE[0]:g} ... {SHAPE[1]:g}"
        )
    return ProjectorNumbers(
        name=f"{place.removeprefix('projector.')}, {name}" if asked.name and asked.model else name,
        throw_ratio=throw_ratio,
        lens_shift=asked.lens_shift,
        lumens=lumens,
        contrast=contrast,
        width_px=int(width_px),
        height_px=int(height_px),
        hfov_deg=math.degrees(2 * math.atan(0.5 / throw_ratio)),
        cost=asked.cost,
        said=tuple(said),
    )


class _NobodySays(Exception):
    """A number that neither file nor documents give."""

    def __init__(self, key: str, what: str) -> None:
        super().__init__(key)
        self.key, self.what = key, what


def _check_lens(place: str, throw_ratio: float, shift: tuple[float, float]) -> None:
    if not THROW[0] <= throw_ratio <= THROW[1]:
        angle = math.degrees(2 * math.atan(0.5 / throw_ratio))
        raise UsageError(
            f"{place}.throw_ratio: {throw_ratio:g} is a picture {angle:.1f} degrees wide; no lens does that "
            f"({THROW[0]:g} ... {THROW[1]:g}): it is the distance over the picture's width"
        )
    if max(abs(one) for one in shift) > MOST_SHIFT:
        raise UsageError(
            f"{place}.lens_shift: {list(shift)} is more than {MOST_SHIFT:g} picture sizes; give shares: 0.5 has the "
            "axis at the picture's edge"
        )


def _throw_ratio(facts: ProjectorFacts, name: str, said: list[str]) -> float:
    if facts.throw_ratio is not None:
        shortest = facts.throw_ratio.value[0]
        said.append(f"throw ratio {shortest:g}: {name}, its widest zoom ({facts.throw_ratio.quote})")
        return float(shortest)
    if facts.throw_example_m is not None:
        distance, width = facts.throw_example_m.value
        said.append(f"throw ratio {distance / width:.3g}: {name} ({facts.throw_example_m.quote})")
        return float(distance / width)
    raise _NobodySays("throw_ratio", "the distance over the picture's width, from its data sheet")


def _lumens(facts: ProjectorFacts, name: str, said: list[str]) -> float:
    fact, how = facts.measured_white_lm or facts.brightness_lm, "as measured"
    if fact is None:
        raise _NobodySays("lumens", "those of white, from its data sheet or a review")
    if facts.measured_white_lm is None:
        how = "as its maker claims; measured ones are mostly lower"
    said.append(f"{fact.value:g} lm: {name}, {how} ({fact.quote})")
    return float(fact.value)


def _contrast(facts: ProjectorFacts, name: str, said: list[str]) -> float:
    if facts.measured_contrast is not None:
        said.append(
            f"contrast {facts.measured_contrast.value:g}: {name}, as measured ({facts.measured_contrast.quote})"
        )
        return float(facts.measured_contrast.value)
    claim = "" if facts.contrast is None else f"; the maker claims {facts.contrast.value:g}, with tricks that dim all"
    said.append(f"contrast {USUAL_CONTRAST:g}: nobody has measured it, this is a guess{claim}")
    return USUAL_CONTRAST


def _cited(key: str, fact: Fact[int] | None, name: str, said: list[str]) -> int:
    if fact is None:
        raise _NobodySays(key, "the picture's own size")
    said.append(f"{key} {fact.value}: {name} ({fact.quote})")
    return fact.value
