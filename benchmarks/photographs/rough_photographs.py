"""Photographs of a code taken with care, in real rooms: which imperfections does a scan bear, and which does it refuse?

    python benchmarks/photographs/rough_photographs.py --sets 180 --seed 1
    python benchmarks/photographs/rough_photographs.py --sets 1 --seed 17 --keep FOLDER   # files for `rig scan`

Things, devices and files are drawn as `drawn_photographs.py` draws them; nothing is exchanged or mistaken. Instead
each set has something that cannot be helped, in turn: shutters that repeat to some per cent, lamps that fade, bands of
the mains, daylight, a lamp that is switched on, tripods that shake or sink, automatic exposure, people who walk
through, projectors that change while the camera reads, highlights, hot pixels, local tone mapping, sharpening, noise
reduction, a greasy lens. Each set has to be right, refused in words, or end with a warning. The last lines say how the
sets of each kind ended.
"""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path

from drawn_photographs import scanned
from drawn_roughness import ROUGHNESS, rough
from set_runs import name_of, tried, try_all


def main() -> int:
    """Scan drawn sets, and print what is not as it should be."""
    ended: Counter[tuple[str, str]] = Counter()

    def judged(seed: int, keep: Path | None) -> tuple[str, str]:
        set_ = rough(seed)
        how, said = tried(seed, keep, lambda folder: scanned(set_, folder))
        if how == "wrong":
            how = "WRONG IN SILENCE"
        ended[set_.fault, how] += 1
        return how, f"{seed}: {set_.fault}: {said} [{set_.drawn}]"

    try_all(__doc__, judged)
    for change in ROUGHNESS:
        name = name_of(change)
        print(f"{name:20}", *(f"{n} {how};" for (kind, how), n in sorted(ended.items()) if kind == name))
    return 0


if __name__ == "__main__":
    sys.exit(main())
