"""Strangers' photographs of boards drawn by chance, lit by Gray code, and what goes wrong with them.

    python benchmarks/photographs/drawn_boards.py --sets 100 --seed 1
    python benchmarks/photographs/drawn_boards.py --sets 1 --seed 17 --keep FOLDER   # files for `rig lenses`

Chessboards, ChArUco and circles; cameras and projectors with distortion and shifted lenses; four to eight poses, noise,
blur, JPEG, room light. Two thirds of the sets have one fault: of the photographs, or of what the manifest says. Lenses
and the pose between them are compared with the truth: within 4.5 of their stated standard deviations, which one set of
two thousand misses by chance. A right set has to end; a set of any kind has to be right, refused in words, or end with
a warning.
"""

from __future__ import annotations

import sys
from pathlib import Path

import cv2
from board_faults import drawn
from board_scenes import BoardSet
from set_runs import is_odd, tried, try_all

from rig.files.lens_file import LensFile, read_lens_file
from rig.lenses.run import run_lenses

SIGMAS = 4.5


def write(set_: BoardSet, folder: Path) -> Path:
    """Write photographs and manifest; return the manifest."""
    for view, frames in enumerate(set_.frames):
        for name, frame in frames.items():
            quality = [cv2.IMWRITE_JPEG_QUALITY, set_.jpeg] if set_.suffix == ".jpg" else []
            cv2.imwrite(str(folder / f"{view}-{name}{set_.suffix}"), frame, quality)
    width, height = set_.told_projector_size
    lines = ["schema = 1", "[camera]", f"full_scale_dn = {set_.told_full_scale_dn}", "[projector]"]
    lines += [f"width_px = {width}", f"height_px = {height}", f"code_step_px = {set_.told_step_px}", "[board]"]
    board = set_.told_board
    lines += [f'kind = "{board.kind}"', f"columns = {board.columns}", f"rows = {board.rows}"]
    lines += [f"square_m = {board.square_m}", f"marker_m = {board.marker_m}"]
    for view in range(len(set_.frames)):
        lines += ["[[view]]", f'name = "pose-{view}"', f'files = "{view}-{{pattern}}{set_.suffix}"']
    path = folder / "lenses.toml"
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


def worst(set_: BoardSet, found: LensFile) -> tuple[float, str]:
    """Largest error over its stated standard deviation, and of what."""
    off: dict[str, tuple[float, float]] = {}
    for role, true in (("camera", set_.state.camera), ("projector", set_.state.projector)):
        lens = next((one for one in found.lens if one.role == role), None)
        if lens is None:
            continue
        numbers = (*lens.focal_px, *lens.principal_point_px)
        for k, name in enumerate(("fx", "fy", "cx", "cy")):
            off[f"{role} {name}"] = (numbers[k] - float(true[k]), lens.sigma[k])
    pose = found.projector_from_camera
    if pose is not None:
        for k, name in enumerate("xyz"):
            apart = pose.translation_m[k] - float(set_.state.projector_translation_m[k])
            off[f"baseline {name}"] = (apart, pose.sigma[3 + k])
    name = max(off, key=lambda key: abs(off[key][0]) / max(off[key][1], 1e-12))
    apart, sigma = off[name]
    return abs(apart) / max(sigma, 1e-12), f"{name} off by {apart:.3g} +- {sigma:.2g}"


def judged(seed: int, keep: Path | None) -> tuple[str, str]:
    """(how it ended, in words) of one set."""
    set_ = drawn(seed)
    how, said = tried(seed, keep, lambda folder: calibrated(set_, folder))
    if how == "wrong":
        how = "WRONG IN SILENCE"
    if set_.fault == "none" and how == "refused":
        how = "refused WITHOUT A FAULT"
    return how, f"{seed}: {set_.fault}: {said} [{set_.drawn}]"


def calibrated(set_: BoardSet, folder: Path) -> tuple[str, str]:
    """(how it ended, in words) of one set."""
    result = run_lenses(write(set_, folder), folder / "lens.toml")
    sigmas, where = worst(set_, read_lens_file(folder / "lens.toml"))
    how = "wrong" if sigmas > SIGMAS else "right"
    unmet = [f"{row.what} {row.value}" for row in result.limits if not row.met and "share of" not in row.what]
    told = (*result.warnings, *unmet)
    said = f"{len(result.devices)} lenses, rms {result.rms_px:.2f} px, {sigmas:.1f} sigma ({where}); {'; '.join(told)}"
    return f"{how}, warned" if told else how, said


def main() -> int:
    """Calibrate drawn sets, and print what is not as it should be."""
    return int(any(is_odd(how) for how in try_all(__doc__, judged)))


if __name__ == "__main__":
    sys.exit(main())
