"""What every compensation strategy starts from and returns; here each is measured against ``direct``."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim.arguments import array_of, number_of
from sim.arrays import BoolArray, FloatArray
from sim.compensation.split_transport import SplitTransport, Transport, as_shown, split_transport_of
from sim.errors import SimulationError
from sim.light.colour import ColourTransport
from sim.light.transport import LightTransport

Notes = Mapping[str, float | str]
FARTHEST = 1e9
"""Ratio of the target's brightest value to the brightest direct light, either way, from which on its unit is wrong."""
LARGEST = 1e60
"""Of a transport: squares of larger numbers leave the range of floating point."""
WORSE = 1 + 1e-6
"""Ratio of errors from which on a strategy says that ``direct`` is better: above the roundoff of equal images."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Compensation:
    """A projector image, and the camera image that the model expects of it; (n,) grey or (n, C) in colour."""

    projector_image: FloatArray
    """p, within the range."""
    predicted: FloatArray
    """T p."""
    clipped: BoolArray
    """Values that the range holds back."""
    residual_rms: float
    """Root mean square of T p - target."""
    iterations: int
    seconds: float
    """Of the strategy itself."""
    notes: Notes = field(default_factory=dict)
    """What the strategy has to say. ``worse_than_direct``, where there is one: how many times the mean or the RMS
    error of ``direct`` this one's is."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Problem:
    """A checked request: a transport, a target and the projector's range."""

    transport: SplitTransport
    """Its projector is taken for sharp, as published methods take it."""
    target: FloatArray
    """(n, C) camera image wanted."""
    lower: float
    """Darkest value of a projector pixel."""
    upper: float
    """Brightest value of a projector pixel."""
    grey: bool
    """The caller's images are (n,)."""
    started_s: float

    @cached_property
    def shown(self) -> SplitTransport:
        """The transport with the projector's blur: what is seen in the end, of every strategy."""
        return as_shown(self.transport)

    def clamped(self, wanted: FloatArray) -> FloatArray:
        """Return an image clamped to the projector's range."""
        return np.clip(wanted, self.lower, self.upper)

    def out_of_range(self, wanted: FloatArray) -> BoolArray:
        """Tell where a wanted image leaves the projector's range."""
        return np.asarray((wanted < self.lower) | (wanted > self.upper))

    def result(
        self, wanted: FloatArray, iterations: int = 1, notes: Notes | None = None, clipped: BoolArray | None = None
    ) -> Compensation:
        """Return the result of a wanted image: clamped to the range, with what it gives, compared with ``direct``.

        Parameters
        ----------
        wanted : (n, C) array
            Projector image; it may leave the range.
        iterations : int
            How many it took to find.
        notes : mapping, optional
            What the strategy has to say.
        clipped : (n, C) bool array, optional
            Values that the range holds back; default: where ``wanted`` leaves it.

        Returns
        -------
        Compensation
            Its images are shaped as the caller's.
        """
        seconds = time.perf_counter() - self.started_s
        p = self.clamped(wanted)
        predicted = self.shown.forward(p)
        return Compensation(
            projector_image=self._shaped(p),
            predicted=self._shaped(predicted),
            clipped=self._shaped(self.out_of_range(wanted) if clipped is None else clipped),
            residual_rms=float(np.sqrt(np.mean((predicted - self.target) ** 2))),
            iterations=iterations,
            seconds=seconds,
            notes=dict(notes or {}) | self._compared(predicted),
        )

    def _compared(self, predicted: FloatArray) -> dict[str, float]:
        by_direct = self.shown.forward(self.clamped(self.transport.divide_by_direct(self.target)))
        ours, direct = (np.abs(seen - self.target) for seen in (predicted, by_direct))
        # An error of direct that is roundoff is no measure.
        least = max(1e-9 * float(np.abs(self.target).max(initial=0.0)), np.finfo(float).tiny)
        worse = max(
            float(ours.mean()) / max(float(direct.mean()), least),
            float(np.linalg.norm(ours)) / max(float(np.linalg.norm(direct)), least * ours.size**0.5),
        )
        return {"worse_than_direct": worse} if worse > WORSE else {}

    def _shaped(self, values: NDArray[Any]) -> NDArray[Any]:
        return values[:, 0] if self.grey else np.ascontiguousarray(values)


def prepare(transport: Transport, target: ArrayLike, lower: float, upper: float) -> Problem:
    """Return the problem that a strategy is asked to solve, checked.

    Parameters
    ----------
    transport : LightTransport or ColourTransport
        Of the projector's view: one camera value a projector pixel.
    target : (n,) or (n, C) array
        Camera image wanted, in the transport's unit.
    lower, upper : float
        The projector's range.

    Returns
    -------
    Problem
        Its images are (n, C), C = 1 for a grey transport.

    Raises
    ------
    SimulationError
        For a target of the wrong shape, not finite or not in the transport's unit, an empty or infinite range, or a
        transport that is not finite or not the projector's view.
    """
    started_s = time.perf_counter()
    if not isinstance(transport, LightTransport | ColourTransport):
        raise SimulationError(f"transport of type {type(transport).__name__}; give a LightTransport or ColourTransport")
    values = array_of("target", target)
    colour = isinstance(transport, ColourTransport)
    channels = transport.channels if isinstance(transport, ColourTransport) else 1
    pixels = transport.shape[0] // channels
    if values.shape != ((pixels, channels) if colour else (pixels,)):
        bands = f" of {channels} bands" if colour else ""
        raise SimulationError(
            f"target of shape {values.shape}; the transport has {pixels} camera pixels{bands}; resample it to them"
        )
    if not np.isfinite(values).all():
        raise SimulationError(
            f"target: {int((~np.isfinite(values)).sum())} of {values.size} values not finite; replace them"
        )
    reach = _checked_reach(lower, upper)
    split = split_transport_of(transport)
    _check_numbers(split)
    _check_unit(values, float(split.diagonal.max(initial=0.0)) * reach)
    return Problem(
        transport=split,
        target=np.asfortranarray(values.reshape(pixels, channels)),
        lower=lower,
        upper=upper,
        grey=not colour,
        started_s=started_s,
    )


def _checked_reach(lower: float, upper: float) -> float:
    """Return the larger bound of a projector's range, 1 where both sides are open. Raises SimulationError for none."""
    if isinstance(lower, float) and isinstance(upper, float) and (lower, upper) == (-np.inf, np.inf):
        return 1.0
    bounds = [number_of(name, bound) for name, bound in (("lower", lower), ("upper", upper))]
    if not lower < upper or any(abs(bound) > LARGEST for bound in bounds):
        raise SimulationError(
            f"projector range {lower:g} ... {upper:g} is empty or beyond {LARGEST:g}; lower must be below upper"
        )
    return max(abs(bound) for bound in bounds)


def _check_numbers(split: SplitTransport) -> None:
    """Raise SimulationError for a transport with numbers that are not finite, or too large to be squared."""
    for b, (band, interreflection) in enumerate(zip(split.bands, split.interreflections, strict=True)):
        parts = {
            "direct light": band.direct_matrix.data,
            "emission": interreflection.emission.data,
            "interreflection": interreflection.patch_to_patch,
            "view": interreflection.view.data,
        }
        for name, numbers in parts.items():
            bad = numbers.size - int(np.count_nonzero(np.abs(numbers) < LARGEST))
            if bad:
                raise SimulationError(
                    f"light transport, band {b}: {bad} of {numbers.size} values of its {name} are NaN, infinite or "
                    f"above {LARGEST:g}; look at what it was made from: reflectance, brightness, gains"
                )


def _check_unit(target: FloatArray, brightest: float) -> None:
    """Raise SimulationError for a target that is far from the brightest direct light; black fits every unit."""
    wanted = float(np.abs(target).max(initial=0.0))
    if wanted > 0 and brightest > 0 and not brightest / FARTHEST <= wanted <= brightest * FARTHEST:
        raise SimulationError(
            f"target: values up to {wanted:.3g}, where the brightest direct light is {brightest:.3g}; give it in the "
            "transport's unit"
        )
