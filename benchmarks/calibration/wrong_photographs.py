"""What a scan makes of photographs that are not what they are called.

    python benchmarks/calibration/wrong_photographs.py

Every exchange of two photographs, every pattern taken for its inverse, every stale frame, a camera bumped by 20 px from
each photograph on, and some that have to pass: the photographs as they are, cut out, saved as poor JPEG, one of them
exposed half as long. Where all photographs are found to be what they are, the cloud is the right set's, and is not
computed again. The scan is done on arrays; photographs are read, or simulated, once, and what all mixtures of them have
in common is computed once. Two sets: a published scan
(`PROCAM_RIG_DATA` or ../shared/data; left out with a word where it is not), and a simulated relief with a baseline that
is vertical.

    --set real|vertical   only this set
    --every N             only each N-th case of a kind
    --kinds a,b           only these kinds
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations, pairwise

import cv2
import numpy as np
from numpy.typing import NDArray
from photograph_sets import (
    EPIPOLAR_LIMIT_PX,
    LIMIT_DN,
    OFF,
    PhotographSet,
    cropped,
    published_folder,
    real_set,
    vertical_set,
)
from shared_work import shared

from calibration.errors import CalibrationError
from rig.devices.replay.photographs import Photograph
from rig.errors import RigError
from rig.offline.photograph_order import in_order
from rig.offline.scan import scan_photographs

FloatArray = NDArray[np.float64]
Frames = Mapping[str, Photograph]

BUMP_PX = 20
KINDS = ("right", "crop", "jpeg", "half-exposure", "exchange", "inversion", "stale", "bump", "whole")
MUST_PASS = ("right", "crop", "jpeg", "half-exposure")


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What became of one case."""

    case: str
    kind: str
    verdict: str
    """refused, mended, warned or passed."""
    off: float
    """Share of the points that are wrong; nan where there is no cloud."""
    points: int
    message: str
    seconds: float

    @property
    def silent(self) -> bool:
        """Whether the cloud is wrong and the exit status 0."""
        return self.verdict in ("passed", "mended") and self.off > OFF

    @property
    def lost(self) -> bool:
        """Whether what has to pass does not."""
        return self.kind in MUST_PASS and self.verdict in ("refused", "warned")


def outcome_of(photographs: PhotographSet, kind: str, case: str, frames: Frames, *, quickly: bool = False) -> Outcome:
    """Scan the photographs of a case; quickly: not those that are found to be what they are."""
    begun_s = time.perf_counter()
    try:
        if quickly and kind not in MUST_PASS and _all_put_right(photographs, frames):
            return Outcome(
                kind=kind,
                case=case,
                verdict="mended",
                off=photographs.scan_off_share,
                points=len(photographs.scan.points_m),
                message="each photograph was found to be what it is",
                seconds=time.perf_counter() - begun_s,
            )
        scan = scan_photographs(
            photographs.manifest,
            frames,
            photographs.devices,
            limit_dn=LIMIT_DN,
            epipolar_limit_px=EPIPOLAR_LIMIT_PX,
        )
    except RigError as error:
        verdict, off, points, message = "refused", float("nan"), 0, str(error).split(": ", 1)[-1]
    else:
        verdict = "warned" if scan.warnings else "mended" if scan.mended else "passed"
        off, points = photographs.off_share(scan), len(scan.points_m)
        message = " | ".join((*scan.warnings, *scan.mended))
    seconds = time.perf_counter() - begun_s
    return Outcome(kind=kind, case=case, verdict=verdict, off=off, points=points, message=message, seconds=seconds)


def _all_put_right(photographs: PhotographSet, frames: Frames) -> bool:
    """Whether each photograph is found to be what it is, without a warning: the scan is then that of the right set."""
    try:
        found = in_order(
            photographs.manifest,
            frames,
            photographs.devices,
            limit_dn=LIMIT_DN,
            epipolar_limit_px=EPIPOLAR_LIMIT_PX,
        )
    except CalibrationError:
        return False
    right = photographs.frames
    return not found.warnings and all(found.frames[name] is right[name] for name in right)


def cases(photographs: PhotographSet, kind: str) -> Iterator[tuple[str, PhotographSet, Frames]]:
    """Yield (name, set, photographs) of a kind of mistake."""
    frames = dict(photographs.frames)
    taken = list(frames)
    if kind == "right":
        yield "as named", photographs, frames
    elif kind == "crop":
        for name, share in (("left half", (0, 0.6, 0, 1)), ("middle", (0.25, 0.85, 0.2, 0.8))):
            cut = cropped(photographs, share)
            yield name, cut, cut.frames
    elif kind == "jpeg":
        yield "quality 20", photographs, {name: as_jpeg(frame, 20) for name, frame in frames.items()}
    elif kind == "half-exposure":
        for name in taken:
            yield name, photographs, {**frames, name: (frames[name] * 0.5).astype(np.uint8)}
    elif kind == "exchange":
        for a, b in combinations(taken, 2):
            if b != f"{a}-inverse":
                yield f"{a} and {b}", photographs, {**frames, a: frames[b], b: frames[a]}
    elif kind == "inversion":
        for a in taken:
            if f"{a}-inverse" in frames:
                yield a, photographs, {**frames, a: frames[f"{a}-inverse"], f"{a}-inverse": frames[a]}
    elif kind == "stale":
        for before, name in pairwise(taken):
            yield name, photographs, {**frames, name: frames[before]}
    elif kind == "bump":
        for axis, name in ((1, "right"), (0, "down")):
            moved = {key: np.roll(frame, BUMP_PX, axis=axis) for key, frame in frames.items()}
            for first in range(1, len(taken)):
                yield (
                    f"{name} from {taken[first]} on",
                    photographs,
                    {key: moved[key] if k >= first else frames[key] for k, key in enumerate(taken)},
                )
    else:
        yield from wholes(photographs, frames)


def wholes(photographs: PhotographSet, frames: Frames) -> Iterator[tuple[str, PhotographSet, Frames]]:
    """Yield mistakes with whole lists: all inverted, fine first, rows for columns, mirrored."""
    flip = {name: name.removesuffix("-inverse") if name.endswith("-inverse") else f"{name}-inverse" for name in frames}
    yield "all inverted", photographs, {name: frames[flip[name]] for name in frames}
    for axis in ("column", "row"):
        mine = [name for name in frames if f"-{axis}-" in name]
        bits = 1 + max(int(name.split("-")[2]) for name in mine)
        other = {name: name.replace(name.split("-")[2], f"{bits - 1 - int(name.split('-')[2]):02d}") for name in mine}
        yield f"{axis}s finest first", photographs, {**frames, **{name: frames[other[name]] for name in mine}}
        top = f"gray-{axis}-{bits - 1:02d}"
        turned = {top: frames[flip[top]], flip[top]: frames[top]}
        yield f"{axis}s mirrored", photographs, {**frames, **turned}
        yield f"all {axis}s inverted", photographs, {**frames, **{name: frames[flip[name]] for name in mine}}
    swapped = {name: name.replace("column", "X").replace("row", "column").replace("X", "row") for name in frames}
    if set(swapped.values()) == set(frames):
        yield "rows for columns", photographs, {name: frames[swapped[name]] for name in frames}


def as_jpeg(frame: Photograph, quality: int) -> Photograph:
    """The photograph saved as JPEG and read again."""
    _, data = cv2.imencode(".jpg", frame, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_GRAYSCALE))


# ---- a simulated relief, lit from above the camera ------------------------------------------------------------------


def print_row(kind: str, outcomes: list[Outcome]) -> None:
    """Print what became of a kind of mistake, and each case that went wrong."""
    verdicts = Counter(outcome.verdict for outcome in outcomes)
    counts = " ".join(f"{verdicts[word]:6d}" for word in ("refused", "mended", "warned", "passed"))
    accepted = [o.off for o in outcomes if o.verdict in ("mended", "passed")]
    worst = f"{100 * max(accepted):8.2f} %" if accepted else "         -"
    seconds = np.mean([o.seconds for o in outcomes])
    silent = sum(o.silent for o in outcomes)
    print(f"{kind:14} {len(outcomes):5d} {counts} {worst} {silent:7d} {seconds:7.2f}", flush=True)
    for outcome in outcomes:
        if outcome.silent or outcome.lost:
            print(f"    {outcome.case}: {outcome.verdict}, {100 * outcome.off:.2f} % off: {outcome.message[:300]}")


def run(photographs: PhotographSet, kinds: list[str], every: int) -> int:
    """Print the table of a set; return how many cases are wrong in silence, or refused though right."""
    height, width = photographs.manifest.camera_shape
    print(f"\n{photographs.name}: {len(photographs.frames)} photographs of {width} × {height} px")
    print("kind           cases refused mended warned passed  worst off  silent  s/case")
    wrong = 0
    for kind in kinds:
        step = 1 if kind in ("right", "crop", "jpeg", "whole") else every
        chosen = [case for k, case in enumerate(cases(photographs, kind)) if k % step == 0]
        with shared():
            outcomes = [outcome_of(of, kind, name, frames, quickly=True) for name, of, frames in chosen]
        print_row(kind, outcomes)
        wrong += sum(o.silent or o.lost for o in outcomes)
    return wrong


def main(arguments: list[str]) -> int:
    """Go through both sets."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--set", choices=("real", "vertical"))
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--kinds", default=",".join(KINDS))
    chosen = parser.parse_args(arguments)
    wrong = 0
    for name, make in (("vertical", vertical_set), ("real", real_set)):
        if chosen.set not in (None, name):
            continue
        photographs = make()
        if photographs is None:
            print(f"no published scan at {published_folder()}; PROCAM_RIG_DATA names the folder that has it")
            continue
        wrong += run(photographs, chosen.kinds.split(","), chosen.every)
    print(f"\nwrong in silence, or refused though right: {wrong}")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
