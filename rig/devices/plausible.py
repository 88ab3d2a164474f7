"""Ranges in which the unit of a number makes sense, each with the mistake that is made most often."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, Field


def plausible(low: float, high: float, advice: str) -> AfterValidator:
    """Return a check that a number can be meant as it is; the advice names the mistake that is made most often."""

    def check(given: float | None) -> float | None:
        if given is not None and not low <= given <= high:
            raise ValueError(f"is {given:g}, plausible are {low:g} ... {high:g}: {advice}")
        return given

    return AfterValidator(check)


SecondsOfDelay = Annotated[float, Field(ge=0), plausible(0, 5, "seconds, not milliseconds?")]
SecondsOfWaiting = Annotated[float, Field(ge=0), plausible(0, 900, "seconds, not milliseconds?")]
SecondsOfWarmUp = Annotated[float, Field(gt=0), plausible(0.01, 7200, "seconds, not milliseconds or minutes?")]
MetresOfPatch = Annotated[float, Field(gt=0), plausible(0.005, 20, "metres, not centimetres or millimetres?")]
MetresOfPlace = Annotated[float, plausible(-200, 200, "metres, not centimetres or millimetres?")]
MetresOfLens = Annotated[float, Field(ge=0), plausible(0, 0.5, "metres, not millimetres?")]
MetresOfFocus = Annotated[float, Field(gt=0), plausible(0.05, 200, "metres, not centimetres or millimetres?")]
Electrons = Annotated[float, Field(ge=0), plausible(0, 1e7, "electrons, not digital numbers?")]
HertzOfLight = Annotated[float, Field(ge=0), plausible(0, 10_000, "hertz, not kilohertz?")]
Degrees = Annotated[float, plausible(-360, 360, "degrees?")]
