"""``rig bench solve``: our solvers and scipy's against a solution refined beyond rounding."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import lu_factor, lu_solve
from scipy.sparse.linalg import LinearOperator, bicgstab, gmres

from rig.benchmark.records import Criterion, Detail, Outcome, Point, Size, joined
from rig.benchmark.timing import median_seconds, peak_mb
from rig.terminal import OnStep
from sim.arrays import FloatArray
from sim.errors import SimulationError
from sim.form_factors import FormFactors, form_factors
from sim.geometry.scene import Scene
from sim.light.radiosity import Precision, Radiosity, Solver, gauss_seidel, jacobi
from sim.scenes.gridded import paper_room

PITCHES_M = {"quick": (0.8,), "default": (0.4, 0.2), "full": (0.4, 0.2, 0.1)}
REFLECTANCES = {"quick": (0.7, 0.9999), "default": (0.7, 0.95, 0.999, 0.9999), "full": (0.7, 0.95, 0.999, 0.9999)}
BUDGET_S = {"quick": 0.1, "default": 1.5, "full": 5.0}
TOLERANCE = 1e-10
MATVEC_LIMIT = 30
LIMIT_S = {576: 0.0015, 2304: 0.020, 9216: 0.5}
STRICT_UP_TO = 0.999
"""Largest reflectance for which the criteria of matvecs and seconds hold."""
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
    detail: Mapping[str, float]
    """Products and the like."""
    error_bound: float | None = None
    """Of the largest error, over the largest emission."""


@dataclass(frozen=True)
class Method:
    """A solver by name."""

    name: str
    timed: Callable[[], Any]
    described: Callable[[], Solved]
    """The same solution, with what is known of it."""


def run(size: Size, on_step: OnStep) -> Outcome:
    """Measure all that ``rig bench solve`` shows."""
    parts: list[Outcome] = []
    total = len(PITCHES_M[size]) * len(REFLECTANCES[size])
    for pitch_m in PITCHES_M[size]:
        scene = paper_room(patch_size_m=pitch_m)
        factors = form_factors(scene, "closed_form")
        for reflectance in REFLECTANCES[size]:
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
    methods, points = [], []
    for method in _methods(system):
        refusal = _refusal(system, method)
        if refusal is None:
            methods.append(method)
        else:
            points.append(refusal)
    seconds = median_seconds({method.name: method.timed for method in methods}, BUDGET_S[size])
    done = [
        _point(system, exact, m.name, solved=m.described(), seconds=seconds[m.name], memory=peak_mb(m.timed))
        for m in methods
    ]
    if size != "quick":
        points += [_slow_point(system, exact, method) for method in _iterations(system)]
    return Outcome(points=(*done, *points), criteria=tuple(_bars(system, done[0])))


def _refusal(system: System, method: Method) -> Point | None:
    """A point without an error if the method says that it cannot do this."""
    try:
        method.timed()
    except SimulationError as error:
        detail = {"reflectance": system.reflectance, "gave_up": str(error)}
        return Point(problem=_name(system), method=method.name, n=system.n, detail=detail)
    return None


def _point(system: System, exact: FloatArray, name: str, solved: Solved, seconds: float, memory: float | None) -> Point:
    largest = float(np.abs(solved.B - exact).max())
    detail = {"reflectance": system.reflectance, "tolerance": TOLERANCE, **solved.detail}
    if solved.error_bound is not None:
        detail["error_bound"] = solved.error_bound
        detail["bound_true"] = largest <= solved.error_bound * float(np.abs(system.E).max())
    error = largest / float(np.abs(exact).max())
    return Point(
        problem=_name(system),
        method=name,
        n=system.n,
        seconds=seconds,
        error=error,
        peak_mb=memory,
        error_of="largest, of the largest radiosity",
        detail=detail,
    )


def _name(system: System) -> str:
    return f"solve, reflectance {system.reflectance:g}"


def _slow_point(system: System, exact: FloatArray, method: Method) -> Point:
    """Timed once only: these take their time, or give up."""
    started = time.perf_counter()
    refusal = _refusal(system, method)
    seconds = time.perf_counter() - started
    return refusal or _point(system, exact, method.name, solved=method.described(), seconds=seconds, memory=None)


def _methods(system: System) -> Iterator[Method]:
    yield _ours(system, "conjugate gradients")
    yield _ours(system, "mixed precision", precision="mixed")
    if system.n <= DIRECT_UP_TO:
        yield _ours(system, "Cholesky", solver="direct")
        yield _peer("scipy LU", lambda: _by_lu(system))
    yield _peer("scipy gmres", lambda: _krylov(system, gmres, {"restart": 60}))
    yield _peer("scipy bicgstab", lambda: _krylov(system, bicgstab, {}))


def _iterations(system: System) -> Iterator[Method]:
    if system.n > DIRECT_UP_TO or (system.n > 600 and system.reflectance > 0.9):
        return
    G = system.reflectance * system.factors.matrix
    yield _peer("Jacobi", lambda: _stepped(jacobi(G, system.E, TOLERANCE, SLOW_STEPS)))
    yield _peer("Gauss-Seidel", lambda: _stepped(gauss_seidel(G, system.E, TOLERANCE, SLOW_STEPS // 2)))


def _ours(system: System, name: str, solver: Solver = "conjugate_gradients", precision: Precision = "double") -> Method:
    def radiosity() -> Radiosity:
        return Radiosity(system.factors, system.reflectance, tolerance=TOLERANCE, solver=solver, precision=precision)

    def described() -> Solved:
        found = radiosity().solution(system.E)
        products = {"matvecs": found.products, "matvecs_single": found.products_single}
        return Solved(found.B, products, found.error_bound)

    return Method(name, lambda: radiosity().solve(system.E), described)


def _peer(name: str, work: Callable[[], Solved]) -> Method:
    return Method(name, work, work)


def _stepped(answer: tuple[FloatArray, int]) -> Solved:
    return Solved(answer[0], {"matvecs": answer[1]})


def _krylov(system: System, method: Callable[..., tuple[FloatArray, int]], options: Detail) -> Solved:
    system.products = 0
    operator = LinearOperator((system.n, system.n), matvec=system.apply, dtype=np.float64)
    B, status = method(operator, system.E, rtol=TOLERANCE, atol=0.0, maxiter=2000, **options)
    if status:
        raise SimulationError(f"{method.__name__}: not within {TOLERANCE:g} after 2000 steps; tell the authors")
    return Solved(np.asarray(B), {"matvecs": system.products})


def _by_lu(system: System) -> Solved:
    matrix = np.eye(system.n) - system.reflectance * system.factors.matrix
    factor = lu_factor(matrix, overwrite_a=True, check_finite=False)
    return Solved(np.asarray(lu_solve(factor, system.E)), {})


def _bars(system: System, point: Point) -> list[Criterion]:
    name = f"solve, N = {system.n}, reflectance {system.reflectance:g}"
    criteria = [
        Criterion(what=f"{name}: error", value=point.error or 0.0, limit=TOLERANCE / (1 - system.reflectance)),
        Criterion(what=f"{name}: error bound true", value=float(point.detail["bound_true"]), limit=1.0, at_least=True),
    ]
    if system.reflectance <= STRICT_UP_TO:
        criteria.append(Criterion(what=f"{name}: products", value=point.detail["matvecs"], limit=MATVEC_LIMIT))
        if system.n in LIMIT_S:
            criteria.append(
                Criterion(
                    what=f"{name}: time", value=point.seconds or 0.0, limit=LIMIT_S[system.n], unit="s", kind="time"
                )
            )
    return criteria
