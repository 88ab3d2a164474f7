"""Lists of corners as text: ``filename x y level`` a line, as mrgingham and mrcal write them (``corners.vnl``)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rig.errors import ProfileError
from rig.terminal.line import counted, first_of

FloatArray = NDArray[np.float64]
LastColumn = Literal["level", "weight"]
_FARTHEST_PX = 1e6
"""No picture is as large, nor is a corner seen so far outside of one."""
_LISTED = 12


@dataclass(frozen=True, eq=False)
class CornerList:
    """Corners in one picture, in the board's order."""

    xy_px: FloatArray
    """(M, 2); NaN where a corner was not seen."""
    weight: FloatArray
    """(M,) inverse of the relative standard deviation; 0: not seen."""


def read_corner_lists(path: Path, corners: int, last_column: LastColumn | None) -> dict[str, CornerList | None]:
    """Read a list of corners; a picture without a board is None.

    Parameters
    ----------
    path
        Of the text.
    corners
        Of the board.
    last_column
        What the fourth column says: a ``level`` of detection (0 finest; each level doubles the standard deviation) or a
        ``weight``; None: what the comment that names the columns says, else a level.

    Raises
    ------
    ProfileError
        A line for each problem.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise ProfileError(f"{path}: cannot be read: {error}; give a text of lines `filename x y level`") from error
    kind = last_column or _kind_of(lines)
    rows: dict[str, list[tuple[float, float, float]]] = {}
    problems = []
    for number, line in enumerate(lines, start=1):
        words = line.split("#")[0].split()
        if not words:
            continue
        entry = _entry(words, kind)
        if entry is None:
            problems.append(
                f"{path}: line {number}: `{line.strip()}` is no `filename x y {kind}`; numbers, pixels up to "
                f"{_FARTHEST_PX:g}, or -"
            )
            continue
        rows.setdefault(words[0], []).append(entry)
    lists = {name: _list_of(found) for name, found in rows.items()}
    problems += _wrong_counts(path, lists, corners)
    if not rows and not problems:
        problems = [f"{path}: names no picture; write lines `filename x y {kind}`"]
    if problems:
        raise ProfileError("\n".join(first_of(problems, _LISTED)))
    return lists


def _kind_of(lines: list[str]) -> LastColumn:
    head = next((line for line in lines if line.startswith("#") and "filename" in line), "")
    return "weight" if "weight" in head else "level"


def _entry(words: list[str], kind: LastColumn) -> tuple[float, float, float] | None:
    """x, y, weight; a weight of 0 for what was not seen; None for what is no entry."""
    if len(words) not in (3, 4):
        return None
    last = words[3] if len(words) == 4 else ("0" if kind == "level" else "1")
    if "-" in (words[1], words[2]):
        return (np.nan, np.nan, 0.0)
    try:
        x, y = float(words[1]), float(words[2])
        value = -1.0 if last == "-" else float(last)
    except ValueError:
        return None
    if not (np.isfinite([x, y, value]).all() and max(abs(x), abs(y)) <= _FARTHEST_PX):
        return None
    if kind == "level":
        return (x, y, 0.5**value if value >= 0 else 0.0)
    return (x, y, max(value, 0.0))


def _list_of(rows: list[tuple[float, float, float]]) -> CornerList | None:
    values = np.array(rows)
    if len(rows) == 1 and not np.isfinite(values[0, 0]):
        return None
    return CornerList(values[:, :2], np.where(np.isfinite(values[:, 0]), values[:, 2], 0.0))


def _wrong_counts(path: Path, lists: Mapping[str, CornerList | None], corners: int) -> list[str]:
    wrong = {name: len(found.xy_px) for name, found in lists.items() if found and len(found.xy_px) != corners}
    if not wrong:
        return []
    counts = sorted(set(wrong.values()))
    if len(counts) == 1 and len(wrong) > len(lists) // 2:
        return [
            f"{path}: lists {counted(counts[0], 'corner')} a picture ({counted(len(wrong), 'picture')}), the board has "
            f"{corners}: correct [board] columns and rows (inner corners, not squares)"
        ]
    return [
        f"{path}: {name}: lists {counted(n, 'corner')}, the board has {corners}: write a line for each, "
        f"`{name} - - -` for those that were not seen, or one such line for no board"
        for name, n in wrong.items()
    ]
