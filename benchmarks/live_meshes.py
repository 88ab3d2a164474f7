"""Live frames on meshes of 2,000 patches: processor time, distance from the definition, and 60 Hz for a minute.

    python benchmarks/live_meshes.py --seconds 60

Two meshes at 1920 x 1080 in colour, the same as those of ``rig bench live``. Frames are timed by the processor time of
all threads, which other programs hardly change, and by the clock. Then the product's own loop shows its test pattern on
a display that keeps 60 Hz; ``bounded`` is compared with as many steps of its definition.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Sequence

os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # as the command ``rig`` does, before the kernel is loaded

import numpy as np

from rig.benchmark.references.live_scene import live_mesh, live_relief, panning_frames
from rig.live.plan import LivePlan, LiveRequest
from rig.live.results import ShowResult
from rig.live.run import run_live
from rig.live.show.compensator import STRATEGIES, warm_compensators
from rig.live.show.controls import Controls
from rig.profile.schema import load_profile
from sim.frame.compensator import FIRST_STEPS, STEPS, FrameCompensator, FrameModel
from sim.reference.frame import reference_bounded, reference_frame

SIZE_PX = (1920, 1080)
MESHES = {"room with a ball": live_mesh, "lit relief": live_relief}
LIMIT_MS = {"exact": 8.0, "bounded": 14.0}
ROUNDS, THREADS = 30, 2


def main(arguments: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0, help="of each show; 0: none")
    chosen = parser.parse_args(arguments)
    for name, build in MESHES.items():
        live = build(*SIZE_PX)
        model = live.model()
        rows, columns = model.inverse.entries.shape[1:]
        print(f"{name}: {live.scene.n_patches} patches, {columns} lit, {rows} viewed, {len(model.sum_rows)} rows")
        for strategy in STRATEGIES:
            print(f"  {strategy}: {_frames(model, strategy)}")
            if chosen.seconds:
                print(f"  {strategy}: {_told(_show(model, strategy, chosen.seconds))}", flush=True)
    return 0


def _frames(model: FrameModel, strategy: str) -> str:
    frames = panning_frames(model.shape, 6)
    compensator, out = FrameCompensator(model, strategy, THREADS), np.empty_like(frames[0])
    off = _off_definition(model, strategy, frames[:2])
    took = []
    for turn in range(ROUNDS):
        processor_s, clock_s = time.process_time(), time.perf_counter()
        compensator.frame(frames[turn % len(frames)], out)
        took.append((time.process_time() - processor_s, time.perf_counter() - clock_s))
    (least, least_clock), (median, median_clock) = 1e3 * np.min(took, axis=0), 1e3 * np.median(took, axis=0)
    return (
        f"processor {least:.1f} ms best, {median:.1f} median; clock {least_clock:.1f}, {median_clock:.1f} "
        f"(bar {LIMIT_MS[strategy]:g}); {off} code from the definition"
    )


def _off_definition(model: FrameModel, strategy: str, frames: Sequence[np.ndarray]) -> int:
    compensator, state, most = FrameCompensator(model, strategy, THREADS), None, 0
    for steps, frame in zip((FIRST_STEPS, STEPS), frames, strict=True):
        if strategy == "bounded":
            defined, state = reference_bounded(model, frame, steps, state)
        else:
            defined = reference_frame(model, frame)
        most = max(most, int(np.abs(compensator.frame(frame).astype(int) - defined).max()))
    return most


def _show(model: FrameModel, strategy: str, seconds: float) -> ShowResult:
    request = LiveRequest(profile="sim-live", sources=("pattern",), strategy=strategy, seconds=seconds, threads=THREADS)
    plan = LivePlan(
        request=request,
        profile=load_profile("sim-live"),
        model_origin="benchmark",
        notes=(),
        compensators=warm_compensators(model, THREADS),
        controls=Controls(strategy=strategy),
    )
    return run_live(plan)


def _told(result: ShowResult) -> str:
    figures = result.figures
    return (
        f"{figures.frames} frames in {result.seconds:.0f} s, {figures.fps_median:.1f} a second, "
        f"{100 * (figures.on_time_share or 0):.2f} % on time, {figures.late_frames} late, {figures.dropped} dropped; "
        f"computing {figures.compute_ms.p50:.1f} ms median, {figures.compute_ms.p99:.1f} at 99 %; "
        f"real time {'yes' if result.real_time else 'no'}"
    )


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
