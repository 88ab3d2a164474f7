"""OBJ files with their faces checked and cut, before the reader sees them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rig.errors import UsageError
from rig.files.faces import pieces, refuse_faces
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
    seen, faults = 0, []
    for i, word in enumerate(words):
        seen += word == "v"
        if word == "f":
            tokens = lines[i].split()[1:]
            corners = _corners(path, i, tokens, seen)
            if any(not 0 <= corner < len(points) for corner in corners):
                faults.append(f"line {i + 1} has corners {' '.join(tokens)}, there are 1 ... {len(points)}")
            elif len(tokens) < 3:
                faults.append(f"line {i + 1} has {counted(len(tokens), 'corner')}")
            elif len(tokens) > 3:
                cut, fault = pieces(points[corners])
                lines[i] = "\n".join("f " + " ".join(tokens[k] for k in piece) for piece in cut)
                faults += [f"line {i + 1}: {fault}"] if fault else []
    refuse_faces(path, faults)
    return "\n".join(lines) + "\n"


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
