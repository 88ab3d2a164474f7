"""Whether a re-check finds a turned camera and a moved projector, and whether realigning brings the picture back.

    nice python benchmarks/recheck.py --work runs/recheck --moves 20 --seed 18 [--profile ci-tiny] [--realign 4]

The session is made once (and found again in ``--work``). Half of the moves turn the camera by 0.1 to 2 degrees about
any axis, half shift the projector by 2 to 50 mm in any direction, evenly in the logarithm; every fifth look is at a rig
that stands still. An error is that of the vector, as a share of its length, and the median distance in pixels by which
walls in the device's picture are elsewhere than the answer says.
"""

from __future__ import annotations

import argparse
import csv
import shutil
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibration.geometry.moved.residual import SHIFT_M, TURN_RAD, moved_device
from calibration.geometry.pinhole import PinholeModel, project, world_rays
from rig.errors import RigError
from rig.profile.schema import Profile, load_profile
from rig.recheck.known import known_rig
from rig.recheck.records import MotionResult, Recheck, RecheckRequest
from rig.recheck.run import run_recheck
from rig.run.request import SessionRequest
from rig.run.session import run_session
from rig.session import Session

FloatArray = NDArray[np.float64]
TURNS_DEG, SHIFTS_MM = (0.1, 2.0), (2.0, 50.0)
SHARE, PIXELS = 0.10, 0.3
"""What a found move may be off by: either."""


@dataclass(frozen=True, kw_only=True)
class Move:
    """A device that was turned or shifted."""

    device: str
    """camera, projector, or nothing."""
    turn_deg: tuple[float, ...] = (0.0, 0.0, 0.0)
    shift_mm: tuple[float, ...] = (0.0, 0.0, 0.0)

    @property
    def size(self) -> float:
        """Degrees or millimetres."""
        return float(np.linalg.norm(self.turn_deg) or np.linalg.norm(self.shift_mm))


@dataclass(frozen=True, kw_only=True)
class Row:
    """One move, and what was found."""

    device: str
    size: float
    found: str
    share_off: float
    px_off: float
    sigmas_off: float
    device_s: float
    lamp_off: float
    error_ratio: float | None

    @property
    def good(self) -> bool:
        """The right device, to 10 % or 0.3 px."""
        return self.found == self.device and (self.share_off <= SHARE or self.px_off <= PIXELS)


def moves(count: int, seed: int) -> Iterator[Move]:
    """Yield random moves, the same for the same seed."""
    random = np.random.default_rng(seed)
    for k in range(count):
        way = random.normal(size=3)
        way /= np.linalg.norm(way)
        share = random.uniform()
        if k % 5 == 4:
            yield Move(device="nothing")
            continue
        low, high = TURNS_DEG if k % 2 == 0 else SHIFTS_MM
        vector = tuple((way * low * (high / low) ** share).tolist())
        yield Move(device="camera", turn_deg=vector) if k % 2 == 0 else Move(device="projector", shift_mm=vector)


def moved_profile(path: Path, move: Move, output: Path) -> Path:
    """Write a copy of a simulated rig's profile in which a device stands elsewhere."""
    text, table = path.read_text(), f"[[simulation.{move.device}]]\n"
    shift_m = [each / 1000 for each in move.shift_mm]
    output.write_text(text.replace(table, f"{table}turned_deg = {list(move.turn_deg)}\nmoved_m = {shift_m}\n"))
    return output


def judged(session: Session, move: Move, result: Recheck) -> Row:
    """Hold an answer against the truth."""
    motion, ratio = {"camera": result.camera, "projector": result.projector}.get(move.device), None
    if result.realigned is not None and result.realigned.error_before and result.realigned.error_after:
        ratio = result.realigned.error_after / result.realigned.error_before
    share, px, sigmas = (0.0, 0.0, 0.0) if motion is None else _errors(session, move, motion)
    return Row(
        device=move.device,
        size=move.size,
        found=result.moved,
        share_off=share,
        px_off=px,
        sigmas_off=sigmas,
        device_s=result.device_s,
        lamp_off=result.light.lamp_gain - 1,
        error_ratio=ratio,
    )


def _errors(session: Session, move: Move, found: MotionResult) -> tuple[float, float, float]:
    """Of the vector as a share, in pixels of the device's picture, and of the vector's length in sigmas."""
    known, unit = known_rig(session), np.repeat([np.degrees(TURN_RAD), 1000 * SHIFT_M], 3)
    device = known.camera if move.device == "camera" else known.projector
    rows, columns = np.nonzero(known.map.valid)
    step = max(1, len(rows) // 5000)
    xy = np.stack([columns, rows], axis=1)[::step].astype(np.float64)
    walls = known.seen_by(known.camera, xy)
    points = _points(known.camera, xy, walls.normal, walls.offset_m)
    true, said = (
        moved_device(device, np.concatenate([turn, shift]) / unit)
        for turn, shift in ((move.turn_deg, move.shift_mm), (found.turn_deg, found.shift_mm))
    )
    px = float(np.median(np.linalg.norm(project(true, points) - project(said, points), axis=1)))
    is_turn = move.device == "camera"
    off = np.subtract(found.turn_deg, move.turn_deg) if is_turn else np.subtract(found.shift_mm, move.shift_mm)
    length = (found.turned_deg if is_turn else found.moved_mm) - move.size
    sigma = found.turned_sigma_deg if is_turn else found.moved_sigma_mm
    return float(np.linalg.norm(off)) / move.size, px, abs(length) / sigma


def _points(camera: PinholeModel, xy: FloatArray, normal: FloatArray, offset: FloatArray) -> FloatArray:
    rays = world_rays(camera, xy)
    along = (offset - normal @ camera.position_m) / (normal * rays).sum(axis=1)
    return np.asarray(camera.position_m + along[:, None] * rays)


def session_in(work: Path, profile: Profile) -> Path:
    """Make the session, unless it is there."""
    folder = work / profile.name
    if not (folder / "metrics.json").is_file():
        run_session(SessionRequest(folder=folder, profile=str(profile.path), strategies=("none", "bounded")))
    return folder


def main(arguments: Sequence[str]) -> int:
    """Measure, print a row each, and the verdict."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--moves", type=int, default=20)
    parser.add_argument("--seed", type=int, default=18)
    parser.add_argument("--profile", default="ci-tiny")
    parser.add_argument("--realign", type=int, default=0, help="of the first so many moves")
    parser.add_argument("--csv", type=Path)
    asked = parser.parse_args(arguments)
    profile = load_profile(asked.profile)
    folder, rows = session_in(asked.work, profile), []
    for k, move in enumerate(moves(asked.moves, asked.seed)):
        moved = moved_profile(profile.path, move, asked.work / f"move-{k:02d}.toml")
        row = _measured(folder, move, moved, realign=k < asked.realign)
        rows.append(row)
        print(row, flush=True)
    good = sum(row.good for row in rows)
    print(f"{good} of {len(rows)} found to {100 * SHARE:g} % or {PIXELS:g} px")
    if asked.csv is not None:
        _write(asked.csv, rows)
    return 0 if good == len(rows) else 1


def _measured(folder: Path, move: Move, profile: Path, *, realign: bool) -> Row:
    """Look at the rig from the session itself: a realigned one before it must not take its place."""
    _forget_looks(folder)
    try:
        result = run_recheck(RecheckRequest(folder=folder, profile=str(profile), realign=realign))
    except RigError as error:
        print(f"{move}: {error}", file=sys.stderr)
        raise
    with Session.read(folder) as session:
        return judged(session, move, result)


def _forget_looks(folder: Path) -> None:
    shutil.rmtree(folder / "rechecks", ignore_errors=True)


def _write(path: Path, rows: Sequence[Row]) -> None:
    with path.open("w", newline="") as stream:
        writer = csv.DictWriter(stream, fieldnames=[*vars(rows[0])])
        writer.writeheader()
        writer.writerows(vars(row) for row in rows)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
