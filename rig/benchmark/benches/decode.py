"""``rig bench decode``: pictures, seconds and error of every structured-light code, as rooms reflect more and more.

The rooms are simulated once a reflectance; the seconds that promises are made of are those of photographs of full size.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import combinations

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration import CODES, Correspondence, StructuredLightCode, flat
from calibration.structured_light.phase.micro_phase import MicroPhaseCode
from calibration.structured_light.phase.three_frequency import ThreeFrequencyCode
from rig.benchmark.records import Criterion, Outcome, Point, Size
from rig.benchmark.references.coded_room import CodedRoom, Reading, room_settings
from rig.benchmark.timing import median_seconds, processor_seconds
from rig.devices.simulated.world import SimulatedWorld
from rig.terminal import OnStep
from sim.threads import threads

Frames = Mapping[str, NDArray[np.uint8]]

REFLECTANCES: Mapping[Size, tuple[float, ...]] = {"quick": (0.7,), "default": (0.2, 0.7, 0.9), "full": (0.2, 0.7, 0.9)}
WIDTHS_PX: Mapping[Size, tuple[int, int]] = {"quick": (200, 192), "default": (400, 448), "full": (960, 1024)}
"""Of camera and projector."""
BUDGET_S: Mapping[Size, float] = {"quick": 0.0, "default": 0.5, "full": 2.0}
"""For repeats of each decoding; 0: one call is all. [s]"""
PARTS = 4
"""In which the rest of a spoiled code is photographed again."""
AGAIN = ("gray", "gray-plain")
"""Codes that light from other walls spoils most."""
ERROR_OF = "median of the coordinates, projector px"

WRONG_SHARE = 0.003
"""Of what is called valid, further than 2 px from the truth; edges where two walls meet have most of it."""
AGREE_PX = 0.3
WITHIN_SIGMA = 2.0
BRIGHT_ROOM_VALID = 0.85
LEAST_VALID = 0.02
"""With less there is no saying how well a code is read: Gray code without inverses in a bright room."""
ROBUST = ("long-run", "three-frequency", "micro-phase")
"""Codes that have to be read in a room of reflectance 0.9."""

TIMED_PROJECTOR, TIMED_CAMERA = (768, 1024), (1080, 1920)
SMALL_CAMERA = (600, 600)
"""360 thousand pixels."""
TIMES_OPENCV = 50.0


def run(size: Size, on_step: OnStep) -> Outcome:
    """Measure all that ``rig bench decode`` shows."""
    rooms = REFLECTANCES[size]
    parts = []
    for k, reflectance in enumerate(rooms):
        parts.append(in_room(reflectance, size, partial(_within, on_step, k, len(rooms) + 1)))
    if size != "quick":
        on_step("full size", len(rooms), len(rooms) + 1)
        parts.append(of_full_size(4.0 if size == "default" else 20.0))
    on_step("decode", len(rooms) + 1, len(rooms) + 1)
    points = tuple(point for part in parts for point in part.points)
    return Outcome(points=points, criteria=tuple(c for part in parts for c in part.criteria), notes=NOTES)


NOTES = (
    "n is pictures, white and black among them. valid: share of the camera pixels that look at the projected picture; "
    "wrong: of these, further than 2 px off; sigmas: errors in units of their stated standard deviations",
)


def _within(on_step: OnStep, done: int, total: int, label: str) -> None:
    on_step(label, done, total)


def in_room(reflectance: float, size: Size, on_label: Callable[[str], None]) -> Outcome:
    """Read every code in one room."""
    camera_px, projector_px = WIDTHS_PX[size]
    settings = room_settings(reflectance, camera_px, projector_px)
    shapes = (camera_px * 3 // 4, camera_px), (projector_px * 3 // 4, projector_px)
    room = CodedRoom(SimulatedWorld(settings, *shapes))
    problem = f"closed room, reflectance {reflectance:g}"
    points, found = [], {}
    for name, code in CODES.items():
        on_label(f"{problem}: {name}")
        frames = room.photographs(code.patterns(room.projector_shape))
        seconds = median_seconds({name: partial(room.decode, code, frames)}, BUDGET_S[size], 5)[name]
        found[name] = room.decode(code, frames)
        points.append(_point(problem, name, room.judge(found[name]), pictures=len(frames) + 2, seconds=seconds))
    for name in AGAIN:
        on_label(f"{problem}: {name} again")
        known, pictures = room.filled_in(CODES[name], found[name], PARTS)
        shown = points[list(CODES).index(name)].n + pictures
        points.append(_point(problem, f"{name}, again with fewer lights", room.judge(known), pictures=shown))
    return Outcome(points=tuple(points), criteria=tuple(accuracy(problem, points, agreement(found))))


def _point(problem: str, method: str, reading: Reading, *, pictures: int, seconds: float | None = None) -> Point:
    return Point(
        problem=problem,
        method=method,
        n=pictures,
        seconds=seconds,
        error=reading.median_px,
        error_of=ERROR_OF,
        detail={
            "images": pictures,
            "ms": None if seconds is None else 1e3 * seconds,
            "valid": reading.valid_share,
            "wrong": reading.wrong_share,
            "p95_px": reading.p95_px,
            "sigmas": reading.sigmas,
        },
    )


def agreement(found: Mapping[str, Correspondence]) -> float:
    """Return the largest median distance, over all pairs of codes, of the coordinates that two read of a scene."""
    apart = []
    for one, other in combinations(found.values(), 2):
        both = one.valid & other.valid
        apart.append(float(np.median(np.abs(one.projector_xy_px - other.projector_xy_px)[both])) if both.any() else 0.0)
    return max(apart)


def accuracy(problem: str, points: Sequence[Point], apart_px: float) -> list[Criterion]:
    """What is promised of the codes in one room."""
    wrong = max(points, key=lambda point: point.detail["wrong"])
    read = [point for point in points if point.detail["valid"] > LEAST_VALID]
    farthest = max(read, key=lambda point: abs(np.log(point.detail["sigmas"])))
    sigmas = float(np.exp(abs(np.log(farthest.detail["sigmas"]))))
    robust = [point for point in points if point.method in ROBUST]
    least = min(robust, key=lambda point: point.detail["valid"])
    return [
        Criterion(
            what=f"{problem}: wrong though called valid, at most ({wrong.method})",
            value=100 * wrong.detail["wrong"],
            limit=100 * WRONG_SHARE,
            unit="%",
        ),
        Criterion(what=f"{problem}: two codes apart, median, at most", value=apart_px, limit=AGREE_PX, unit="px"),
        Criterion(
            what=f"{problem}: errors over their sigmas, or the inverse ({farthest.method})",
            value=sigmas,
            limit=WITHIN_SIGMA,
            unit="x",
        ),
        Criterion(
            what=f"{problem}: valid of the robust codes, at least ({least.method})",
            value=least.detail["valid"],
            limit=BRIGHT_ROOM_VALID,
            unit="",
            at_least=True,
        ),
    ]


def of_full_size(budget_s: float) -> Outcome:
    """Seconds of photographs of full size, beside OpenCV's Gray decode in the same turns."""
    cases: dict[str, tuple[StructuredLightCode, tuple[int, int]]] = {
        "gray": (CODES["gray"], TIMED_CAMERA),
        "long-run": (CODES["long-run"], TIMED_CAMERA),
        "three-frequency, columns": (ThreeFrequencyCode(axes=("column",)), TIMED_CAMERA),
        "micro-phase, columns": (MicroPhaseCode(axes=("column",)), SMALL_CAMERA),
    }
    cv2.setNumThreads(threads())
    seen = {name: _seen(code, camera) for name, (code, camera) in cases.items()}
    work = {name: partial(_read, code, *seen[name]) for name, (code, _) in cases.items()}
    opencv = partial(_read_by_opencv, *seen["gray"])
    seconds = median_seconds({**work, "opencv structured_light": opencv}, budget_s, 9)
    points = []
    for name, taken in seconds.items():
        frames, _ = seen.get(name, seen["gray"])
        height, width = next(iter(frames.values())).shape
        pictures = len(frames) + 2
        detail = {"images": pictures, "ms": 1e3 * taken, "threads": threads()}
        if name in work:
            detail["processor_ms"] = 1e3 * processor_seconds(work[name])
        points.append(Point(problem=f"{width}x{height}", method=name, n=pictures, seconds=taken, detail=detail))
    return Outcome(points=tuple(points), criteria=tuple(_times(seconds)))


def _times(seconds: Mapping[str, float]) -> list[Criterion]:
    limits_ms = {"gray": 30.0, "three-frequency, columns": 60.0, "micro-phase, columns": 300.0}
    criteria = [
        Criterion(what=f"full size: {name}", value=1e3 * seconds[name], limit=limit, unit="ms", kind="time")
        for name, limit in limits_ms.items()
    ]
    ratio = seconds["opencv structured_light"] / seconds["gray"]
    return [
        *criteria,
        Criterion(
            what="full size: gray over OpenCV's",
            value=ratio,
            limit=TIMES_OPENCV,
            unit="x faster",
            kind="time",
            at_least=True,
        ),
    ]


def _seen(code: StructuredLightCode, camera: tuple[int, int]) -> tuple[Frames, tuple[NDArray[np.uint8], ...]]:
    """8-bit photographs of a plane, with noise: of a code's pictures, and of white and black."""
    height, width = camera
    y, x = np.mgrid[:height, :width].astype(np.float32)
    map_x, map_y = 0.52 * x + 0.02 * y, 0.69 * y + 0.01 * x
    random = np.random.default_rng(5)

    def photograph(codes: NDArray[np.uint8]) -> NDArray[np.uint8]:
        light = cv2.remap(codes.astype(np.float32), map_x, map_y, cv2.INTER_LINEAR)
        noisy = 12 + 200 / 255 * light + random.normal(0, 1.5, camera)
        return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)

    frames = {pattern.name: photograph(pattern.codes) for pattern in code.patterns(TIMED_PROJECTOR)}
    return frames, tuple(photograph(flat(TIMED_PROJECTOR, level).codes) for level in (255, 0))


def _read(code: StructuredLightCode, frames: Frames, flats: tuple[NDArray[np.uint8], ...]) -> Correspondence:
    white, black = flats
    return code.decode(frames, TIMED_PROJECTOR, white=white, black=black, noise_limit=4.3, saturation=250)


def _read_by_opencv(frames: Frames, flats: tuple[NDArray[np.uint8], ...]) -> object:
    """Decode by OpenCV, which takes two cameras and gives their disparity: the same pictures for both."""
    height, width = TIMED_PROJECTOR
    pattern = cv2.structured_light.GrayCodePattern.create(width, height)
    images = [list(frames.values())] * 2
    white, black = flats
    return pattern.decode(images, None, [black, black], [white, white])
