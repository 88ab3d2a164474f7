"""``rig bench solve``: our solvers and scipy's against a solution refined beyond rounding."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import lu_factor, lu_solve
from scipy.sparse.linalg import LinearOperator, bicgstab, gmres

from rig.workflows.bench.records import Bar, OnStep, Outcome, Point, Size, joined
from rig.workflows.bench.timing import median_seconds, peak_mb, seconds_of
from sim.errors import SimulationError
from sim.form_factors import FormFactors, form_factors
from sim.radiosity import Radiosity, gauss_seidel, jacobi
from sim.scene import FloatArray, Scene
from sim.scenes import paper_room

PITCHES_M = {"quick": (0.8,), "default": (0.4, 0.2), "full": (0.4, 0.2, 0.1)}
REFLECTANCES = (0.7, 0.95, 0.999, 0.9999)
TOLERANCE = 1e-10
MATVEC_LIMIT = 30
LIMIT_S = {576: 0.0015, 2304: 0.020, 9216: 0.5}
STRICT_UP_TO = 0.999
"""Largest reflectance for which the bars of matvecs and seconds hold."""
SLOW_STEPS = 3000
"""Steps after which the paper's iterations are given up."""
DIRECT_UP_TO = 2400
"""Patches up to which a factorisation is timed."""
ROWS_AT_ONCE = 256


@dataclass(eq=False)
class System:
    """(I - G) B = E, and products counted."""

    factors: FormFactors
    reflectance: float
    E: FloatArray
    products: int = 0

    def apply(self, x: FloatArray) -> FloatArray:
        """(I - G) x."""
        self.products += 1
        return np.asarray(x - self.reflectance * (self.factors.matrix @ x))

    @property
    def n(self) -> int:
        """Number of patches."""
        return len(self.E)


@dataclass(frozen=True)
class Solved:
    """What a method gives."""

    B: FloatArray
    products: int | None = None
    error_bound: float | None = None


def run(size: Size, on_step: OnStep) -> Outcome:
    """Measure all that ``rig bench solve`` shows."""
    parts: list[Outcome] = []
    total = len(PITCHES_M[size]) * len(REFLECTANCES)
    for pitch_m in PITCHES_M[size]:
        scene = paper_room(patch_size_m=pitch_m)
        factors = form_factors(scene, "closed_form")
        for reflectance in REFLECTANCES:
            on_step(f"N = {scene.n_patches}, reflectance {reflectance:g}", len(parts), total)
            parts.append(_measured(System(factors, reflectance, floor_light(scene, reflectance)), size))
    on_step("solve", total, total)
    return joined(parts)


def floor_light(scene: Scene, reflectance: float) -> FloatArray:
    """(P,) emission of a floor under white light: half in light, half dark, so that no method guesses it."""
    E = np.zeros(scene.n_patches)
    patches = np.arange(scene.n_patches)[scene.faces[0].patches]
    E[patches[: len(patches) // 2]] = reflectance
    return E


def exact_solution(system: System, rounds: int = 4) -> FloatArray:
    """Solve and refine with residuals in extended precision until the correction is below rounding."""
    radiosity = Radiosity(system.factors, system.reflectance)
    B = radiosity.solve(system.E).astype(np.longdouble)
    for _ in range(rounds):
        B += radiosity.solve(_residual(system, B).astype(np.float64))
    return B.astype(np.float64)


def _residual(system: System, B: Any) -> Any:
    residual = system.E - B
    for start in range(0, system.n, ROWS_AT_ONCE):
        rows = slice(start, start + ROWS_AT_ONCE)
        residual[rows] += system.reflectance * (system.factors.matrix[rows].astype(np.longdouble) @ B)
    return residual


def _measured(system: System, size: Size) -> Outcome:
    exact = exact_solution(system)
    methods = dict(_methods(system, size))
    points, slow = [], dict(_iterations(system)) if size != "quick" else {}
    seconds = median_seconds(methods, budget_s=1.5)
    for name, method in methods.items():
        points.append(_point(system, exact, name, method(), seconds[name], peak_mb(method)))
    for name, method in slow.items():
        points.append(_slow_point(system, exact, name, method))
    return Outcome(tuple(points), tuple(_bars(system, points[0])))


def _point(system: System, exact: FloatArray, name: str, solved: Solved, seconds: float, memory: float | None) -> Point:
    error = float(np.abs(solved.B - exact).max() / np.abs(exact).max())
    detail: dict[str, Any] = {"reflectance": system.reflectance, "tolerance": TOLERANCE}
    if solved.products is not None:
        detail["matvecs"] = solved.products
    if solved.error_bound is not None:
        detail["error_bound"] = solved.error_bound
        detail["bound_true"] = bool(np.abs(solved.B - exact).max() <= solved.error_bound * np.abs(system.E).max())
    problem = f"solve, reflectance {system.reflectance:g}"
    return Point(problem, name, system.n, seconds, error, memory, "largest, of the largest radiosity", detail)


def _slow_point(system: System, exact: FloatArray, name: str, method: Callable[[], Solved]) -> Point:
    """One run only; a method that gives up has no error and says so."""
    solved: list[Solved] = []
    try:
        seconds = seconds_of(lambda: solved.append(method()))
    except SimulationError as error:
        detail = {"reflectance": system.reflectance, "gave_up": str(error)}
        return Point(f"solve, reflectance {system.reflectance:g}", name, system.n, detail=detail)
    return _point(system, exact, name, solved[0], seconds, None)


def _methods(system: System, size: Size) -> Iterator[tuple[str, Callable[[], Solved]]]:
    yield "conjugate gradients", lambda: _ours(system)
    yield "scipy gmres", lambda: _krylov(system, gmres, {"restart": 60})
    yield "scipy bicgstab", lambda: _krylov(system, bicgstab, {})
    if system.n <= DIRECT_UP_TO:
        yield "scipy LU", lambda: _by_lu(system)


def _iterations(system: System) -> Iterator[tuple[str, Callable[[], Solved]]]:
    if system.n > DIRECT_UP_TO or (system.n > 600 and system.reflectance > 0.9):
        return
    G = system.reflectance * system.factors.matrix
    yield "Jacobi", lambda: Solved(*jacobi(G, system.E, TOLERANCE, SLOW_STEPS))
    yield "Gauss-Seidel", lambda: Solved(*gauss_seidel(G, system.E, TOLERANCE, SLOW_STEPS // 10))


def _ours(system: System) -> Solved:
    radiosity = Radiosity(system.factors, system.reflectance, tolerance=TOLERANCE)
    B = radiosity.solve(system.E)
    return Solved(B, None, radiosity.accuracy(B, system.E).error_bound)


def _krylov(system: System, method: Callable[..., tuple[FloatArray, int]], options: dict[str, Any]) -> Solved:
    system.products = 0
    operator = LinearOperator((system.n, system.n), matvec=system.apply, dtype=np.float64)
    B, status = method(operator, system.E, rtol=TOLERANCE, atol=0.0, maxiter=2000, **options)
    if status:
        raise SimulationError(f"{method.__name__}: not within {TOLERANCE:g} after 2000 steps")
    return Solved(np.asarray(B), system.products)


def _by_lu(system: System) -> Solved:
    matrix = np.eye(system.n) - system.reflectance * system.factors.matrix
    return Solved(np.asarray(lu_solve(lu_factor(matrix, overwrite_a=True, check_finite=False), system.E)))


def _bars(system: System, point: Point) -> list[Bar]:
    name = f"solve, N = {system.n}, reflectance {system.reflectance:g}"
    bars = [
        Bar(f"{name}: error", point.error or 0.0, TOLERANCE / (1 - system.reflectance)),
        Bar(f"{name}: error bound true", float(point.detail["bound_true"]), 1.0, at_least=True),
    ]
    if system.reflectance <= STRICT_UP_TO:
        if "matvecs" in point.detail:
            bars.append(Bar(f"{name}: matvecs", point.detail["matvecs"], MATVEC_LIMIT))
        if system.n in LIMIT_S:
            bars.append(Bar(f"{name}: time", point.seconds or 0.0, LIMIT_S[system.n], "s", "time"))
    return bars
