"""``rig bench form-factors``: closed form, polygons, the paper's samples and peers against exact references."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from rig.benchmark import peers
from rig.benchmark.benches import occlusion
from rig.benchmark.records import Criterion, Detail, Outcome, Point, Size, joined
from rig.benchmark.references.polygon import exchange_reference, largest_relative_error
from rig.benchmark.references.room import errors_of
from rig.benchmark.timing import median_seconds, peak_mb
from rig.terminal import OnStep
from sim.arrays import FloatArray
from sim.form_factors import FormFactors, closed_form, form_factors, paper, polygon
from sim.geometry.scene import Scene
from sim.geometry.surface import Surface
from sim.scenes.gridded import paper_room
from sim.scenes.meshes import sloped_room
from sim.threads import set_threads, threads

PITCHES_M = {"quick": (0.8,), "default": (0.4, 0.2, 0.1), "full": (0.4, 0.2, 0.1)}
BUDGET_S = {"quick": 0.1, "default": 2.0, "full": 6.0}
"""For the repeats of one problem."""
ROOM_LIMIT_S = {576: 0.004, 2304: 0.050, 9216: 0.8}
POLYGON_UP_TO = {"quick": 600, "default": 600, "full": 2400}
"""Patches up to which the empty room is also done as polygons."""
SLOPED_TURN_DEG = (20.0, 30.0, 40.0)


@dataclass(frozen=True)
class Case:
    """A method with one setting."""

    name: str
    work: Callable[[], FormFactors]
    samples: int | None = None

    def detail(self, factors: FormFactors) -> Detail:
        """What a result says of itself."""
        samples = {} if self.samples is None else {"samples": self.samples}
        return {
            **samples,
            "closure_max": factors.closure_max,
            "reciprocity": _asymmetry(factors),
            "threads": threads(),
        }


def _asymmetry(factors: FormFactors, rows_at_once: int = 512) -> float:
    """Largest |A_i F_ij - A_j F_ji| over the largest A_i F_ij, by blocks of rows that keep memory low."""
    largest, difference = 0.0, 0.0
    for start in range(0, len(factors.areas), rows_at_once):
        rows = slice(start, start + rows_at_once)
        exchange = factors.areas[rows, None] * factors.matrix[rows]
        reverse = (factors.areas[:, None] * factors.matrix[:, rows]).T
        difference = max(difference, float(np.abs(exchange - reverse).max()))
        largest = max(largest, float(exchange.max()))
    return difference / largest


def run(size: Size, on_step: OnStep) -> Outcome:
    """Measure all that ``rig bench form-factors`` shows."""
    parts: list[Outcome] = []
    rooms = [("empty paper room", _empty_room, pitch_m) for pitch_m in PITCHES_M[size]]
    others = [("sloped room", _sloped_room), ("box occluder", occlusion.box), ("threads", _thread_scaling)]
    total = len(rooms) + len(others)
    for label, measure, pitch_m in rooms:
        on_step(f"{label}, {pitch_m:g} m", len(parts), total)
        parts.append(measure(pitch_m, size))
    for label, part in others:
        on_step(label, len(parts), total)
        parts.append(part(size))
    on_step("form factors", total, total)
    return joined(parts)


def _empty_room(pitch_m: float, size: Size) -> Outcome:
    scene = paper_room(patch_size_m=pitch_m)
    n = scene.n_patches
    cases = [Case("closed_form", lambda: form_factors(scene, "closed_form"))]
    if n <= POLYGON_UP_TO[size]:
        cases += _polygon_cases(scene)
    if n <= 2400:
        cases.append(Case("paper", lambda: form_factors(scene, "paper"), samples=9))
    points = _measured(
        "empty room",
        scene,
        cases,
        error_of=lambda matrix: errors_of(matrix, scene, pitch_m)[0],
        budget_s=BUDGET_S[size],
    )
    criteria = _room_bars(points[0])
    if n == 576:
        criteria += _paper_bars(form_factors(scene, "paper"))
    if n == 576 and size != "quick" and peers.present("pyviewfactor"):
        peer, criterion = _against_pyviewfactor(scene, pitch_m)
        points, criteria = [*points, peer], [*criteria, criterion]
    return Outcome(points=tuple(points), criteria=tuple(criteria))


def _polygon_cases(surface: Surface) -> list[Case]:
    def case(samples: int) -> Case:
        return Case(f"polygon {samples}", lambda: form_factors(surface, "polygon", samples=samples), samples)

    return [case(9), case(25)]


def _measured(
    problem: str,
    surface: Surface,
    cases: Sequence[Case],
    error_of: Callable[[FloatArray], float],
    budget_s: float,
) -> list[Point]:
    seconds = median_seconds({case.name: case.work for case in cases}, budget_s)
    points = []
    for case in cases:
        memory = peak_mb(case.work)
        factors = case.work()
        error = error_of(factors.matrix)
        n = surface.n_patches
        detail = {**case.detail(factors), "peak_of_matrix": memory / (8e-6 * n**2)}
        points.append(
            Point(
                problem=problem,
                method=case.name,
                n=n,
                seconds=seconds[case.name],
                error=error,
                peak_mb=memory,
                error_of="largest relative",
                detail=detail,
            )
        )
    return points


def _room_bars(point: Point) -> list[Criterion]:
    name = f"closed form, N = {point.n}"
    criteria = [
        Criterion(what=f"{name}: largest relative error", value=point.error or 0.0, limit=1e-8),
        Criterion(what=f"{name}: closure", value=point.detail["closure_max"], limit=1e-10),
        Criterion(what=f"{name}: reciprocity, to rounding", value=point.detail["reciprocity"], limit=1e-15),
    ]
    if point.n in ROOM_LIMIT_S:
        criteria.append(
            Criterion(
                what=f"{name}: time", value=point.seconds or 0.0, limit=ROOM_LIMIT_S[point.n], unit="s", kind="time"
            )
        )
        criteria.append(
            Criterion(
                what=f"{name}: peak over the matrix",
                value=point.detail["peak_of_matrix"],
                limit=1.15,
                unit="",
                kind="memory",
            )
        )
    return criteria


def _paper_bars(factors: FormFactors) -> list[Criterion]:
    rows = factors.row_sums
    return [
        Criterion(what="paper: lowest row sum less 1.0004", value=abs(float(rows.min()) - 1.0004), limit=1e-4),
        Criterion(what="paper: highest row sum less 1.0869", value=abs(float(rows.max()) - 1.0869), limit=1e-4),
        Criterion(what="paper: spectral radius less 1.0197", value=abs(factors.spectral_radius - 1.0197), limit=1e-4),
    ]


def _against_pyviewfactor(scene: Scene, pitch_m: float) -> tuple[Point, Criterion]:
    mesh = peers.pyviewfactor_mesh(scene)
    seconds = median_seconds(
        {"ours": lambda: form_factors(scene, "closed_form"), "peer": lambda: peers.pyviewfactor_factors(mesh)},
        repeats=3,
        budget_s=5.0,
    )
    matrix = peers.pyviewfactor_factors(mesh)
    error = errors_of(matrix, scene, pitch_m)[0]
    memory = peak_mb(lambda: peers.pyviewfactor_factors(mesh))
    ratio = seconds["peer"] / seconds["ours"]
    closure = float(np.abs(matrix.sum(axis=1) - 1).max())
    detail = {"closure_max": closure, "ratio": ratio}
    point = Point(
        problem="empty room",
        method="pyviewfactor",
        n=576,
        seconds=seconds["peer"],
        error=error,
        peak_mb=memory,
        error_of="largest relative",
        detail=detail,
    )
    return point, Criterion(
        what="closed form over pyviewfactor, N = 576",
        value=ratio,
        limit=300.0,
        unit="x faster",
        kind="time",
        at_least=True,
    )


def _sloped_room(size: Size) -> Outcome:
    turn = Rotation.from_euler("xyz", SLOPED_TURN_DEG, degrees=True).as_matrix()
    surface = sloped_room(0.8 if size == "quick" else 0.4, turn)
    reference = exchange_reference(surface)
    points = _measured(
        "sloped room",
        surface,
        _polygon_cases(surface),
        error_of=lambda matrix: largest_relative_error(matrix, surface, reference),
        budget_s=BUDGET_S[size],
    )
    nine, twenty_five = points
    criteria = (
        Criterion(what="sloped room, 9 samples: largest relative error", value=nine.error or 0.0, limit=2e-4),
        Criterion(what="sloped room, 25 samples: largest relative error", value=twenty_five.error or 0.0, limit=1e-6),
        Criterion(what="sloped room, 9 samples: time", value=nine.seconds or 0.0, limit=0.012, unit="s", kind="time"),
    )
    return Outcome(points=tuple(points), criteria=criteria)


def _thread_scaling(size: Size) -> Outcome:
    scene = paper_room(patch_size_m=0.8 if size == "quick" else 0.4 / 3)
    # Into memory that is there: handing out fresh pages is the operating system's work, and not shared.
    matrix, row_sums = np.empty((scene.n_patches,) * 2), np.empty(scene.n_patches)
    works: dict[str, Callable[[], Any]] = {
        "closed_form": lambda: closed_form.fill(scene, matrix, row_sums),
        "paper": lambda: paper.fill(scene, matrix, row_sums),
        "polygon 9": lambda: polygon.fill_exchange_areas(scene, matrix, samples=9, tolerance=1e-6),
    }
    before = threads()
    try:
        both = {f"{name}/{k}": _with_threads(k, work) for name, work in works.items() for k in (1, 2)}
        seconds = median_seconds(both, BUDGET_S[size])
    finally:
        set_threads(before)
    points, criteria = [], []
    for name in works:
        for k in (1, 2):
            points.append(
                Point(
                    problem="threads",
                    method=name,
                    n=scene.n_patches,
                    seconds=seconds[f"{name}/{k}"],
                    detail={"threads": k},
                )
            )
        gain = seconds[f"{name}/1"] / seconds[f"{name}/2"]
        criteria.append(
            Criterion(
                what=f"{name}: 2 threads over 1", value=gain, limit=1.8, unit="x faster", kind="time", at_least=True
            )
        )
    return Outcome(points=tuple(points), criteria=tuple(criteria))


def _with_threads(count: int, work: Callable[[], Any]) -> Callable[[], Any]:
    def run_it() -> None:
        set_threads(count)
        work()

    return run_it
