"""Sets of photographs, tried one after the other, each in a folder of its own; those that end oddly are printed."""

from __future__ import annotations

import argparse
import shutil
import tempfile
import traceback
from collections import Counter
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import NamedTuple

from rig.errors import RigError


class Ended(NamedTuple):
    """How a set ended."""

    how: str
    said: str
    kind: str
    """What was done to it."""
    drawn: str
    """What it is, in words."""


def tried(seed: int, keep: Path | None, attempt: Callable[[Path], tuple[str, str]]) -> tuple[str, str]:
    """(how it ended, in words) of one attempt in a folder, which is refused, crashes, or says it itself."""
    folder = Path(tempfile.mkdtemp()) if keep is None else keep / str(seed)
    folder.mkdir(parents=True, exist_ok=True)
    try:
        how, said = attempt(folder)
    except RigError as error:
        how, said = "refused", str(error)
    except Exception:  # noqa: BLE001 - whatever is no refusal in words is what is looked for
        how, said = "CRASHED", " | ".join(traceback.format_exc().splitlines()[-7:])
    finally:
        if keep is None:
            shutil.rmtree(folder)
    return how, said.replace(str(folder), "")


def try_all(description: str | None, judged: Callable[[int, Path | None], tuple[str, str]]) -> Counter[str]:
    """How many sets ended how, as the command line asks for them."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sets", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--all", action="store_true", help="print every set")
    parser.add_argument("--keep", type=Path, help="keep photographs and manifests there")
    wanted = parser.parse_args()
    counts: Counter[str] = Counter()
    for seed in range(wanted.seed, wanted.seed + wanted.sets):
        how, said = judged(seed, wanted.keep)
        counts[how] += 1
        if wanted.all or is_odd(how):
            print(f"{how}: {said}", flush=True)
    print(*(f"{n} {how}" for how, n in counts.most_common()), sep="\n")
    return counts


def try_kinds(
    description: str | None, kinds: Iterable[Callable[..., None]], attempt: Callable[[int, Path | None], Ended]
) -> None:
    """Try sets with each of these in turn, none of which may be wrong in silence; say how those of each kind ended."""
    ended: Counter[tuple[str, str]] = Counter()

    def judged(seed: int, keep: Path | None) -> tuple[str, str]:
        end = attempt(seed, keep)
        how = "WRONG IN SILENCE" if end.how == "wrong" else end.how
        ended[end.kind, how] += 1
        return how, f"{seed}: {end.kind}: {end.said} [{end.drawn}]"

    try_all(description, judged)
    for name in map(name_of, kinds):
        print(f"{name:20}", *(f"{n} {how};" for (kind, how), n in sorted(ended.items()) if kind == name))


def name_of(change: Callable[..., None]) -> str:
    """Return what is done to a set, by the name of the function that does it: `_lamp_fades` is `lamp-fades`."""
    return change.__name__.strip("_").replace("_", "-")


def is_odd(how: str) -> bool:
    """Whether no set may end so."""
    return how.upper() == how or "WITHOUT" in how
