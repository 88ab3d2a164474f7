"""OBJ files with their faces checked and cut, before the reader sees them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rig.errors import UsageError
from rig.files.faces import CutFaces, cut_faces, refuse_faces
from rig.terminal.line import counted


def obj_with_cut_faces(path: Path) -> str:
    """Return the text of an OBJ file, its faces of more than three corners cut into triangles.

    Raises
    ------
    UsageError
        For a face with a corner that does not exist, fewer than three, or one that is no surface; names the lines.
    """
    lines = path.read_text(encoding="utf-8", errors="replace").replace("\\\n", " ").splitlines()
    words = [line.split(None, 1)[0] if line.strip() else "" for line in lines]
    points = np.array([_three_numbers(path, i, lines[i]) for i, word in enumerate(words) if word == "v"]).reshape(-1, 3)
    seen, faults, large = 0, {}, {}
    for i, word in enumerate(words):
        seen += word == "v"
        if word == "f":
            tokens = lines[i].split()[1:]
            corners = _corners(path, i, tokens, seen)
            if any(not 0 <= corner < len(points) for corner in corners):
                faults[i] = f"line {i + 1} has corners {' '.join(tokens)}, there are 1 ... {len(points)}"
            elif len(tokens) < 3:
                faults[i] = f"line {i + 1} has {counted(len(tokens), 'corner')}"
            elif len(tokens) > 3:
                large[i] = corners
    places = list(large)
    cut = cut_faces(points, list(large.values()))
    faults |= {places[k]: f"line {places[k] + 1}: {fault}" for k, fault in cut.faults.items()}
    refuse_faces(path, [fault for _, fault in sorted(faults.items())])
    _write_pieces(lines, places, cut)
    return "\n".join(lines) + "\n"


def _write_pieces(lines: list[str], places: list[int], cut: CutFaces) -> None:
    """Put the triangles of each cut face in the place of its line."""
    ends = np.searchsorted(cut.face, np.arange(len(places) + 1)).tolist()
    triangles = cut.triangles.tolist()
    for i, begin, end in zip(places, ends, ends[1:], strict=False):
        tokens = lines[i].split()[1:]
        lines[i] = "\n".join(f"f {tokens[a]} {tokens[b]} {tokens[c]}" for a, b, c in triangles[begin:end])


def _corners(path: Path, place: int, tokens: list[str], seen: int) -> list[int]:
    """Places of the corners of a face among all; negative numbers count back from the last one before it."""
    try:
        numbers = [int(token.partition("/")[0]) for token in tokens]
    except ValueError as error:
        raise UsageError(f"{path}: cannot be read as OBJ: line {place + 1}: {error}; export it again") from error
    # There is no corner 0.
    return [number - 1 if number >= 0 else (seen + number if seen + number >= 0 else -1) for number in numbers]


def _three_numbers(path: Path, place: int, line: str) -> list[float]:
    try:
        x, y, z = (float(number) for number in line.split()[1:4])
    except ValueError as error:
        raise UsageError(f"{path}: cannot be read as OBJ: line {place + 1}: {error}; export it again") from error
    return [x, y, z]
