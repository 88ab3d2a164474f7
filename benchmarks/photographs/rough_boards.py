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

import sys
from collections import Counter
from pathlib import Path

from board_roughness import BOARD_ROUGHNESS, rough_boards
from drawn_boards import calibrated
from set_runs import name_of, tried, try_all


def main() -> int:
    """Calibrate drawn sets, and print what is not as it should be."""
    ended: Counter[tuple[str, str]] = Counter()

    def judged(seed: int, keep: Path | None) -> tuple[str, str]:
        set_ = rough_boards(seed)
        how, said = tried(seed, keep, lambda folder: calibrated(set_, folder))
        if how == "wrong":
            how = "WRONG IN SILENCE"
        ended[set_.fault, how] += 1
        return how, f"{seed}: {set_.fault}: {said} [{set_.drawn}]"

    try_all(__doc__, judged)
    for change in BOARD_ROUGHNESS:
        name = name_of(change)
        print(f"{name:20}", *(f"{n} {how};" for (kind, how), n in sorted(ended.items()) if kind == name))
    return 0


if __name__ == "__main__":
    sys.exit(main())
