"""``rig bench live``: one frame of live compensation, its seconds beside OpenCV's and numpy's, and its error."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray

from rig.benchmark.records import Criterion, Outcome, Point, Size, joined
from rig.benchmark.references.live_peers import NumpyFrame, OpenCvFrame
from rig.benchmark.references.live_scene import LiveScene, live_mesh, live_relief, live_scene, panning_frames
from rig.benchmark.timing import Work, median_seconds, processor_seconds
from rig.terminal import OnStep
from sim.compensation import compensate
from sim.frame.compensator import FrameCompensator, FrameModel
from sim.geometry.scene import Scene
from sim.reference.frame import reference_frame
from sim.threads import threads

Codes = NDArray[np.uint8]
Method = Callable[[Codes], Codes]

PICTURES: dict[str, tuple[tuple[int, int, float], ...]] = {
    "quick": ((320, 180, 0.4),),
    "default": ((1920, 1080, 0.2),),
    "full": ((1920, 1080, 0.2), (3840, 2160, 0.2)),
}
"""Width, height [px], patch size [m]."""
MESHES: dict[str, Callable[[int, int], LiveScene]] = {"on a mesh": live_mesh, "on a lit mesh": live_relief}
"""Of 2150 patches, 842 of them lit, and of 1968, of which 1613 are lit."""
ON_MESHES: dict[str, tuple[tuple[int, int], ...]] = {"quick": (), "default": ((1920, 1080),), "full": ((1920, 1080),)}
"""Width, height of pictures on meshes. [px]"""
CERTIFIED: dict[str, tuple[int, int, int]] = {"quick": (96, 54, 4), "default": (320, 180, 8), "full": (480, 270, 12)}
"""Width, height, frames of the pictures whose optimum is certified."""
FRAMES = 6
LIMITS_S = {
    "1920x1080": {"exact": 5e-3, "bounded": 1 / 60},
    "1920x1080 on a mesh": {"exact": 8e-3, "bounded": 14e-3},
    "1920x1080 on a lit mesh": {"exact": 8e-3, "bounded": 14e-3},
}
"""Of a frame, by the problem."""
FASTER = {"opencv": 7.0, "numpy": 15.0}
PEERS_UP_TO_PX = 1080
"""Height of the largest picture that the peers take part in."""
LARGEST_LSB = 1.0
OVER_OPTIMUM = 1.05
ERROR_OF = "predicted - wanted camera image, rms grey levels"


def run(size: Size, on_step: OnStep) -> Outcome:
    """Measure all that ``rig bench live`` shows."""
    pictures = PICTURES[size]
    found = []
    for number, (width, height, patch_size_m) in enumerate(pictures):
        on_step(f"frames of {width} x {height}", number, len(pictures) + 1)
        found.append(_picture(live_scene(width, height, patch_size_m), f"{width}x{height}", size))
    for width, height in ON_MESHES[size]:
        for name, mesh in MESHES.items():
            on_step(f"frames of {width} x {height} {name}", len(pictures), len(pictures) + 1)
            found.append(_picture(mesh(width, height), f"{width}x{height} {name}", size))
    on_step("certified optimum", len(pictures), len(pictures) + 1)
    found.append(_certified(*CERTIFIED[size]))
    on_step("certified optimum", len(pictures) + 1, len(pictures) + 1)
    return joined(found)


def _picture(live: LiveScene, problem: str, size: Size) -> Outcome:
    model = live.model()
    frames = panning_frames(live.lens.shape, FRAMES)
    methods = _methods(live, model)
    works = {name: _endless(method, frames) for name, method in methods.items()}
    seconds = median_seconds(works, budget_s=0.2 if size == "quick" else 20.0, repeats=25)
    definition = reference_frame(model, frames[-1]).astype(int)
    points = []
    for name, method in methods.items():
        # Before the picture that is looked at: all of them lie in the same memory.
        processor_ms = 1e3 * processor_seconds(works[name])
        shown = [method(frame) for frame in frames][-1]
        detail = {
            "threads": threads(),
            "lit": model.n_lit,
            "frames_per_second": 1 / seconds[name],
            "processor_ms": processor_ms,
        }
        if name != "bounded":
            detail["largest_lsb"] = float(np.abs(shown - definition).max())
        error = live.error(frames[-1], shown)
        points.append(
            Point(
                problem=problem,
                method=name,
                n=live.scene.n_patches,
                seconds=seconds[name],
                error=error,
                peak_mb=None,
                error_of=ERROR_OF,
                detail=detail,
            )
        )
    return Outcome(points=tuple(points), criteria=tuple(_bars(problem, points)))


def _methods(live: LiveScene, model: FrameModel) -> dict[str, Method]:
    """Each one's codes for a frame's; OpenCV and numpy only on gridded walls, where their tables fit the memory."""
    out = np.empty((*model.shape, 3), dtype=np.uint8)
    methods: dict[str, Method] = {
        "exact": partial(FrameCompensator(model, "exact", threads()).frame, out=out),
        "bounded": partial(FrameCompensator(model, "bounded", threads()).frame, out=out),
    }
    if model.shape[0] <= PEERS_UP_TO_PX and isinstance(live.scene, Scene):
        cv2.setNumThreads(threads())
        methods |= {"opencv": OpenCvFrame(live, model), "numpy": NumpyFrame(model)}
    return methods


def _endless(work: Method, frames: Sequence[Codes]) -> Work:
    """One frame a call, forwards and backwards, so that no frame follows itself."""
    order = [*frames, *frames[-2:0:-1]]
    turn = iter(range(1 << 62))
    return lambda: work(order[next(turn) % len(order)])


def _bars(problem: str, points: Sequence[Point]) -> list[Criterion]:
    by_name = {point.method: point for point in points}
    lsb = by_name["exact"].detail["largest_lsb"]
    criteria = [Criterion(what=f"{problem}: exact against its definition", value=lsb, limit=LARGEST_LSB, unit="codes")]
    if problem not in LIMITS_S:
        return criteria
    seconds = {name: point.seconds or np.nan for name, point in by_name.items()}
    for name, limit_s in LIMITS_S[problem].items():
        criteria.append(
            Criterion(
                what=f"{problem}: {name}, a frame",
                value=1e3 * seconds[name],
                limit=1e3 * limit_s,
                unit="ms",
                kind="time",
            )
        )
    for peer, times in FASTER.items() if "opencv" in seconds else ():
        ratio = seconds[peer] / seconds["exact"]
        criteria.append(
            Criterion(
                what=f"{problem}: exact over {peer}",
                value=ratio,
                limit=times,
                unit="x faster",
                kind="time",
                at_least=True,
            )
        )
    return criteria


def _certified(width: int, height: int, count: int) -> Outcome:
    """Each frame of a pan against the least-squares optimum that its strategy certifies."""
    live = live_scene(width, height, 0.4)
    model = live.model()
    compensators = {"exact": FrameCompensator(model, "exact"), "bounded": FrameCompensator(model, "bounded")}
    errors: dict[str, list[float]] = {name: [] for name in ("certified", *compensators)}
    for frame in panning_frames(live.lens.shape, count):
        errors["certified"].append(_optimum(live, frame))
        for name, compensator in compensators.items():
            errors[name].append(live.error(frame, compensator.frame(frame)))
    problem = f"{width}x{height} pan"
    points = [
        Point(
            problem=problem,
            method=name,
            n=live.scene.n_patches,
            seconds=None,
            error=float(np.median(values)),
            peak_mb=None,
            error_of=ERROR_OF,
            detail={"frames": count},
        )
        for name, values in errors.items()
    ]
    worst = float(np.max(np.divide(errors["bounded"], errors["certified"])))
    return Outcome(
        points=tuple(points),
        criteria=(
            Criterion(
                what=f"{problem}: bounded over certified, worst frame", value=worst, limit=OVER_OPTIMUM, unit="x"
            ),
        ),
    )


def _optimum(live: LiveScene, frame: Codes) -> float:
    """The certified optimum's error in grey levels; the bands count alike, as in a live frame."""
    wanted = live.curve[frame.reshape(-1, 3)] * live.target_scale - live.black
    best = compensate("bounded", live.transport, wanted, tolerance=1e-3)
    return 255 * float(np.sqrt(np.mean(((best.predicted - wanted) / live.target_scale) ** 2)))
