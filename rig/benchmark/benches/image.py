"""``rig bench image``: pictures of the paper's room against a path tracer's stored block means, and its time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from rig.benchmark import checkout, peers
from rig.benchmark.records import Criterion, Detail, Outcome, Point, Size
from rig.benchmark.timing import median_seconds, peak_mb
from rig.terminal import OnStep
from sim.arrays import FloatArray
from sim.form_factors import form_factors
from sim.geometry.optics import Lens, Pose
from sim.picture.image import Reconstruction, SimulatedImage, simulate_image
from sim.scenes.gridded import paper_room

PITCHES_M = {"quick": (0.8,), "default": (0.4, 0.2, 0.1), "full": (0.4, 0.2, 0.1)}
RECONSTRUCTIONS: tuple[Reconstruction, ...] = ("patch", "smooth", "gather")
GATHER_FROM_M = {"quick": 9.0, "default": 0.2, "full": 0.1}
"""Finest patches whose picture is also gathered; far slower than the others."""
RMS_LIMITS = {("patch", 0.2): 0.005, ("patch", 0.1): 0.0025, ("smooth", 0.4): 0.005, ("smooth", 0.2): 0.005}
RMS_LIMITS |= {("smooth", 0.1): 0.0025}
BIAS_LIMIT = 0.001
WHOLE_PITCH_M, WHOLE_LIMIT_S = 0.2, 0.120
FASTER = 1000.0
PEER_SPP, PEER_NOISE = 16, 0.01
PROBLEM = "white picture, 640 x 480"


@dataclass(frozen=True, eq=False, kw_only=True)
class Reference:
    """What the path tracer left in rig/benchmark/data/path_tracer_blocks.npz."""

    blocks: FloatArray
    """(rows, columns) means of square blocks of pixels."""
    standard_error: float
    """Of a block, relative, rms."""
    block_px: int
    reflectance: float
    lens: Lens
    pose: Pose
    seconds_at_one_percent: float
    tracer: str

    def block_means(self, picture: FloatArray) -> FloatArray:
        """The same blocks of another picture."""
        rows, columns = self.blocks.shape
        return np.asarray(picture.reshape(rows, self.block_px, columns, self.block_px).mean(axis=(1, 3)))


def run(size: Size, on_step: OnStep) -> Outcome:
    """Measure all that ``rig bench image`` shows."""
    reference = _reference()
    points: list[Point] = []
    pitches = PITCHES_M[size]
    for number, pitch_m in enumerate(pitches):
        on_step(f"picture, patches of {pitch_m:g} m", number, len(pitches) + 1)
        points += _pictures(reference, pitch_m, size)
    on_step("path tracer", len(pitches), len(pitches) + 1)
    live = _live_seconds() if size != "quick" and peers.present("mitsuba") else None
    if live is not None:
        points.append(live)
    on_step("path tracer", len(pitches) + 1, len(pitches) + 1)
    error = f"standard error of a block {100 * reference.standard_error:.3f} %"
    return Outcome(
        points=tuple(points),
        criteria=tuple(_bars(points, reference)),
        notes=(f"path tracer: {reference.tracer}; {error}",),
    )


def _reference() -> Reference:
    with np.load(checkout.data_file("path_tracer_blocks.npz")) as stored:
        height_px, width_px = (int(side) for side in stored["image_px"])
        mean = stored["block_mean"]
        lens = Lens.from_horizontal_field_of_view(width_px, height_px, float(stored["horizontal_field_of_view_deg"]))
        noise = float(stored["pixel_noise"])
        return Reference(
            blocks=mean,
            standard_error=float(np.sqrt(((stored["block_standard_error"] / mean) ** 2).mean())),
            block_px=int(stored["block_px"]),
            reflectance=float(stored["reflectance"]),
            lens=lens,
            pose=Pose.look_at(stored["position_m"], stored["target_m"]),
            seconds_at_one_percent=float(np.median(stored["seconds"])) * (noise / PEER_NOISE) ** 2,
            tracer=str(stored["tracer"]),
        )


def _pictures(reference: Reference, pitch_m: float, size: Size) -> list[Point]:
    scene = paper_room(reflectance=reference.reflectance, patch_size_m=pitch_m)
    white = np.ones(reference.lens.shape)

    def picture(reconstruction: Reconstruction) -> SimulatedImage:
        factors = form_factors(scene, "closed_form")
        return simulate_image(
            scene,
            factors,
            reference.lens,
            reference.pose,
            projector_image=white,
            reconstruction=reconstruction,
            emission="area",
        )

    kinds = [kind for kind in RECONSTRUCTIONS if kind != "gather" or pitch_m >= GATHER_FROM_M[size]]
    works: dict[str, Callable[[], SimulatedImage]] = {kind: partial(picture, kind) for kind in kinds}
    seconds = median_seconds(works, budget_s=0.1 if size == "quick" else 2.0, repeats=9)
    points = []
    for kind, work in works.items():
        result = work()
        detail = {"pitch_m": pitch_m, **_errors(reference, result.camera_image)}
        detail |= {f"{stage}_s": value for stage, value in result.seconds.items()}
        memory = peak_mb(work) if kind != "gather" else None
        rms = detail["rms"]
        points.append(
            Point(
                problem=PROBLEM,
                method=kind,
                n=scene.n_patches,
                seconds=seconds[kind],
                error=rms,
                peak_mb=memory,
                error_of="blocks, relative rms",
                detail=detail,
            )
        )
    return points


def _errors(reference: Reference, picture: FloatArray) -> Detail:
    error = reference.block_means(picture) / reference.blocks - 1
    return {
        "bias": float(error.mean()),
        "rms": float(np.sqrt((error**2).mean())),
        "largest": float(np.abs(error).max()),
    }


def _live_seconds() -> Point | None:
    """Two short renders now: their difference tells the noise, and noise and time the time of 1 % noise."""
    tracer = checkout.script("path_tracer")
    if tracer is None:
        return None
    mitsuba = tracer.load_mitsuba("llvm_ad_rgb" if tracer.find_llvm() else "scalar_rgb")
    _, falloff = tracer.pixel_geometry()
    scene = tracer.scene_of(mitsuba, falloff / np.pi, tracer.MAX_DEPTH)
    tracer.render(mitsuba, scene, PEER_SPP, 10_000)  # compiles
    (first, first_s), (second, second_s) = (tracer.render(mitsuba, scene, PEER_SPP, seed) for seed in (1, 2))
    noise = float(np.sqrt(((first - second) ** 2).mean() / 2) / first.mean())
    seconds = min(first_s, second_s) * (noise / PEER_NOISE) ** 2
    detail = {"samples": PEER_SPP, "measured_s": min(first_s, second_s), "pixel_noise": noise}
    name = f"Mitsuba {mitsuba.__version__}, 1 % noise"
    return Point(
        problem=PROBLEM,
        method=name,
        n=0,
        seconds=seconds,
        error=PEER_NOISE,
        peak_mb=None,
        error_of="pixel noise",
        detail=detail,
    )


def _bars(points: list[Point], reference: Reference) -> list[Criterion]:
    criteria = []
    for point in points:
        limit = RMS_LIMITS.get((point.method, point.detail.get("pitch_m", 0.0)))
        if limit is not None:
            name = f"{point.method}, {point.detail['pitch_m']:g} m"
            criteria.append(
                Criterion(what=f"{name}: block rms", value=100 * (point.error or 0.0), limit=100 * limit, unit="%")
            )
            if point.detail["pitch_m"] != 0.4:
                criteria.append(
                    Criterion(
                        what=f"{name}: bias", value=100 * abs(point.detail["bias"]), limit=100 * BIAS_LIMIT, unit="%"
                    )
                )
    return criteria + _time_bars(points, reference)


def _time_bars(points: list[Point], reference: Reference) -> list[Criterion]:
    whole = [p for p in points if p.method == "smooth" and p.detail["pitch_m"] == WHOLE_PITCH_M]
    if not whole or whole[0].seconds is None:
        return []
    live = [p.seconds for p in points if p.method.startswith("Mitsuba") and p.seconds is not None]
    peer_s, when = (live[0], "in this run") if live else (reference.seconds_at_one_percent, "as stored")
    return [
        Criterion(
            what=f"whole simulation, {WHOLE_PITCH_M:g} m",
            value=whole[0].seconds,
            limit=WHOLE_LIMIT_S,
            unit="s",
            kind="time",
        ),
        Criterion(
            what=f"over Mitsuba at 1 % noise, {when}",
            value=peer_s / whole[0].seconds,
            limit=FASTER,
            unit="x faster",
            kind="time",
            at_least=True,
        ),
    ]
