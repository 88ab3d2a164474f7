"""Carry out a model: light on patches, form factors, radiosity, and what is left over."""

from __future__ import annotations

import time
import warnings
from dataclasses import dataclass

import numpy as np

from sim.arrays import FloatArray
from sim.errors import SimulationError
from sim.form_factors import form_factors
from sim.form_factors.compressed import compressed_form_factors
from sim.form_factors.factors import ClosureWarning, Method, Visibility
from sim.geometry.adaptive_patches import AdaptivePatches
from sim.light.lighting import Lighting, emission
from sim.light.radiosity import FormFactorOperator, Radiosity
from sim.light.sampled_light import SampledLight, lengthened, received, sampled_light
from sim.planning.linear_light import linear_light
from sim.progress import OnProgress, part_of, unheard

SLOPES_NOISE = 1.6
"""Error that rays leave of linear light, over that of the means alone: 1.4 to 1.8 in corners with a ball and with other
things, 128 to 2,048 rays."""
MOST_LENGTHENED = 6
"""Times that more rays are sent until slopes are known well enough, too."""
FACTORS_SHARE = 0.8
"""Of the work, roughly."""
HIGHEST_ROW_SUM = 1.1
"""Fair visibility leaves up to 0.09 in a furnished room; more is no shadow's defect, and grows by rho / (1 - rho)."""


@dataclass(frozen=True, kw_only=True)
class Model:
    """How light between patches is computed."""

    method: Method
    """``closed_form``, ``polygon`` or ``rays``: of the form factors."""
    visibility: Visibility
    """``none``, ``fair``, ``exact``, or ``rays``."""
    residual: float
    """Of the iterative solver, over the right-hand side."""
    compression: float | None = None
    """Tolerance of the compressed form factors (``sim.form_factors.compressed``); None: the whole matrix."""
    sampling: float | None = None
    """RMS over the surface of the radiosity that rays may leave; 1 = white. None: no rays."""
    linear: bool = False
    """With rays: light is linear within each patch, not one number."""
    seed: int = 0
    """Of the rays."""
    reflectances: tuple[float, ...] | None = None
    """Different reflectances of the colours, if one holds for the whole scene; None: the patches' own."""

    @property
    def visibility_done(self) -> str:
        """``none``, ``fair``, ``exact``, or ``rays`` between compressed blocks."""
        return self.visibility if self.compression is None or self.visibility == "none" else "rays"


@dataclass(frozen=True, eq=False, kw_only=True)
class Simulation:
    """The light of a scene."""

    cells: AdaptivePatches
    reflectance: FloatArray
    """(P, C) one column for each different colour."""
    E: FloatArray
    """(P, C) emission; 1 = white."""
    B: FloatArray
    """(P, C) radiosity; 1 = white."""
    irradiance: FloatArray
    """(P, C) from other patches, H = F B; by rays, the mean of that and of what each patch's own bring. 1 = white."""
    slopes: FloatArray | None
    """(P, 3, C) gradients of the irradiance in each patch's plane [1/m], which hold where it is not negative; None: one
    number a patch."""
    factors: FormFactorOperator
    spectral_radius: float
    """Of diag(rho) F, the largest of all colours: the share of the light that a bounce keeps."""
    products: int
    """Products with F that the solver took, all colours together."""
    residual: float
    """max |E - (I - G) B| over max |E|, the largest of all colours."""
    energy_balance: float
    """Share of the emitted power that is neither absorbed by a patch nor leaves through an opening."""
    sampling_error: float
    """RMS over the surface of the radiosity that rays left, estimated; 1 = white. 0 without rays."""
    factors_s: float
    light_s: float
    solve_s: float

    def irradiance_at(self, pieces: AdaptivePatches) -> FloatArray:
        """Return the irradiance at the centres of pieces of the patches.

        Parameters
        ----------
        pieces : AdaptivePatches
            As many of each patch, first pieces of all before second ones: ``cells.quarters()``.

        Returns
        -------
        (pieces, C) array
            1 = white.
        """
        return light_at(pieces, self.cells, self.irradiance, self.slopes)


def light_at(
    pieces: AdaptivePatches, cells: AdaptivePatches, means: FloatArray, slopes: FloatArray | None
) -> FloatArray:
    """Return light at the centres of pieces of cells, (pieces, C), from (P, C) means and (P, 3, C) slopes or None."""
    each = pieces.n_patches // cells.n_patches
    values = np.tile(means, (each, 1))
    if slopes is None:
        return values
    offset = pieces.centres - np.tile(cells.centres, (each, 1))
    # No light is below 0, so that the field's negative part is nearer to the truth as 0, whatever that is.
    values += np.einsum("pk,pkc->pc", offset, np.tile(slopes, (each, 1, 1)))
    return np.asarray(np.maximum(values, 0.0))


def simulate(cells: AdaptivePatches, light: Lighting, model: Model, on_progress: OnProgress = unheard) -> Simulation:
    """Return the radiosity of patches under a test lighting.

    Parameters
    ----------
    cells : AdaptivePatches
    light : Lighting
    model : Model
        As of a :class:`Plan`, ``simulate(plan.cells, plan.light, plan.model)``.
    on_progress : callable
        Is told the share that is done, where form factors are compressed or come from rays.

    Returns
    -------
    Simulation

    Raises
    ------
    SimulationError
        As form factors and solver do.
    """
    clock_s = [time.perf_counter()]
    irradiance = emission(cells, light).irradiance
    if model.reflectances is None:
        rho = cells.reflectance[:, None]
    else:
        rho = np.tile(model.reflectances, (cells.n_patches, 1))
    E = rho * irradiance[:, None]
    clock_s.append(time.perf_counter())
    factors, sampled = _factors(cells, model, E, rho, on_progress=part_of(on_progress, 0.0, FACTORS_SHARE))
    clock_s.append(time.perf_counter())
    systems = [Radiosity(factors, column, tolerance=model.residual) for column in rho.T]
    solutions = [system.solution(light) for system, light in zip(systems, E.T, strict=True)]
    B = np.stack([solution.B for solution in solutions], axis=1)
    spectral_radius = max(system.spectral_radius(tolerance=1e-3) for system in systems)
    H = factors.apply(B)
    energy_balance = _energy_balance(factors, rho, E=E, B=B, H=H)
    if sampled:
        # Reciprocal factors are as noisy as single entries where light is uneven, which the halves of rows do not show:
        # a patch's own rays know more, and the mean of both the most.
        H = _received(sampled, rho, B)
        B = E + rho * H
    slopes, slopes_error = None, 0.0
    if sampled and model.linear:
        slopes, squared = _linear(cells, sampled, rho, B=B, H=H)
        slopes_error = _rms(cells, squared)
    clock_s.append(time.perf_counter())
    light_s, factors_s, solve_s = np.diff(clock_s)
    return Simulation(
        cells=cells,
        reflectance=rho,
        E=E,
        B=B,
        irradiance=H,
        slopes=slopes,
        factors=factors,
        spectral_radius=spectral_radius,
        products=sum(solution.products for solution in solutions),
        residual=max(solution.residual for solution in solutions),
        energy_balance=energy_balance,
        sampling_error=float(np.hypot(sampled.error if sampled else 0.0, slopes_error)),
        factors_s=float(factors_s),
        light_s=float(light_s),
        solve_s=float(solve_s),
    )


def _energy_balance(
    factors: FormFactorOperator, rho: FloatArray, *, E: FloatArray, B: FloatArray, H: FloatArray
) -> float:
    """Share of the emitted power that light between patches loses or gains."""
    areas, row_sums = factors.areas[:, None], factors.row_sums[:, None]
    absorbed = float((areas * (1 - rho) * H).sum())
    escaped = float((areas * B * (1 - row_sums)).sum())
    emitted = float((areas * E).sum())
    return abs(1 - (absorbed + escaped) / emitted) if emitted > 0 else 0.0


def _received(sampled: SampledLight, rho: FloatArray, B: FloatArray) -> FloatArray:
    """(P, C) irradiance by rays."""
    weights = sampled.factors.areas[:, None] * rho**2
    columns = zip(B.T, weights.T, strict=True)
    return np.stack([received(sampled.sample, sampled.factors, *column).H for column in columns], axis=1)


def _linear(
    cells: AdaptivePatches, sampled: SampledLight, rho: FloatArray, *, B: FloatArray, H: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """(P, 3, C) slopes of the irradiance, and (P, C) the squared errors that their noise leaves of the radiosity."""
    fields = [linear_light(sampled.sample, cells, *columns) for columns in zip(B.T, H.T, strict=True)]
    slopes = np.stack([field.slopes for field in fields], axis=2)
    return slopes, rho**2 * np.stack([field.squared_error for field in fields], axis=1)


def _rms(cells: AdaptivePatches, squared: FloatArray) -> float:
    """RMS over the surface of the colour that is worst, of (P, C) squared errors, without bias by noise."""
    return float(np.sqrt(max(0.0, float((cells.areas @ squared).max())) / cells.areas.sum()))


def _factors(
    cells: AdaptivePatches, model: Model, E: FloatArray, rho: FloatArray, on_progress: OnProgress
) -> tuple[FormFactorOperator, SampledLight | None]:
    """The form factors, which create no light, and the sample if they come from rays."""
    sampled = _sampled(cells, model, E, rho, on_progress=on_progress) if model.sampling is not None else None
    factors = sampled.factors if sampled else _exact(cells, model, on_progress)
    highest = float(factors.row_sums.max())
    if highest > HIGHEST_ROW_SUM:
        raise SimulationError(
            f"the form factors of a patch add up to {highest:.4f}, the limit is {HIGHEST_ROW_SUM:g}: they would create "
            "light; look for patches that cover each other, or are very small beside others"
        )
    return factors, sampled


def _sampled(
    cells: AdaptivePatches, model: Model, E: FloatArray, rho: FloatArray, on_progress: OnProgress
) -> SampledLight:
    """Rays until the light of the brightest colour, which bounces most, is known well enough, and its slopes, too."""
    brightest = int(rho.max(axis=0).argmax())
    emitted, reflectance, allowed = E[:, brightest], rho[:, brightest], float(model.sampling or 0.0)
    error = allowed / (SLOPES_NOISE if model.linear else 1.0)
    sampled = sampled_light(cells, emitted, reflectance, error=error, seed=model.seed, on_progress=on_progress)
    for _ in range(MOST_LENGTHENED if model.linear else 0):
        sent_back = sampled.B - emitted
        H = np.divide(sent_back, reflectance, out=np.zeros_like(sent_back), where=reflectance > 0)
        squared = _linear(cells, sampled, reflectance[:, None], B=sampled.B[:, None], H=H[:, None])[1]
        if sampled.error >= allowed or np.hypot(sampled.error, _rms(cells, squared)) <= allowed:
            break  # the means took all rays that there are, or all is known
        # Walls whose mean light is known at once, as in a furnace, may need many rays for their slopes.
        longer = lengthened(sampled.sample, squared[:, 0], goal=np.sqrt(allowed**2 - sampled.error**2))
        sampled = sampled_light(cells, emitted, reflectance, error=error, sample=longer, on_progress=on_progress)
    return sampled


def _exact(cells: AdaptivePatches, model: Model, on_progress: OnProgress) -> FormFactorOperator:
    if model.compression is not None:
        return compressed_form_factors(cells, model.compression, on_progress, keep_within_closure=True)
    with warnings.catch_warnings():
        if model.visibility != "none":
            # The defect that is left of shadows is planned for, and reported.
            warnings.simplefilter("ignore", ClosureWarning)
        return form_factors(cells, model.method, model.visibility, keep_within_closure=True)
