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

from pathlib import Path

from drawn_photographs import scanned
from drawn_roughness import ROUGHNESS, rough
from set_runs import Ended, tried, try_kinds


def attempt(seed: int, keep: Path | None) -> Ended:
    """How one set ends."""
    set_ = rough(seed)
    how, said = tried(seed, keep, lambda folder: scanned(set_, folder))
    return Ended(how, said, set_.fault, set_.drawn)


if __name__ == "__main__":
    try_kinds(__doc__, ROUGHNESS, attempt)
