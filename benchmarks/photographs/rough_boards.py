"""Boards photographed with care, in real rooms: what does a calibration bear, and what does it refuse?

    python benchmarks/photographs/rough_boards.py --sets 120 --seed 1
    python benchmarks/photographs/rough_boards.py --sets 1 --seed 17 --keep FOLDER   # files for `rig lenses`

Boards, devices and files are drawn as `drawn_boards.py` draws them; nothing is exchanged or mistaken. Instead each set
has something that cannot be helped, in turn: boards that are bowed, twisted, wrinkled, lifted at a corner or printed
unevenly, a wall behind them, poses out of focus, another exposure for each pose, a faint projector, fingers, a camera's
tone curve, vignetting; then what `rough_photographs.py` does to photographs, to those of every pose. Each set has to be
right, refused in words, or end with a warning. The last lines say how the sets of each kind ended.
"""

from __future__ import annotations

from pathlib import Path

from board_roughness import BOARD_ROUGHNESS, rough_boards
from drawn_boards import calibrated
from set_runs import Ended, tried, try_kinds


def attempt(seed: int, keep: Path | None) -> Ended:
    """How one set ends."""
    set_ = rough_boards(seed)
    how, said = tried(seed, keep, lambda folder: calibrated(set_, folder))
    return Ended(how, said, set_.fault, set_.drawn)


if __name__ == "__main__":
    try_kinds(__doc__, BOARD_ROUGHNESS, attempt)
