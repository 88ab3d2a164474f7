"""Collapsing edges in a process of its own, so that an interrupt ends it: the library itself listens to none."""

from __future__ import annotations

import io
import subprocess
import sys
from importlib.util import find_spec

import numpy as np

from sim.arrays import FloatArray, IntArray
from sim.errors import SimulationError

LIBRARY = "fast_simplification"
WORK = """
import io, signal, sys
signal.signal(signal.SIGINT, signal.SIG_IGN)  # the process that waits hears it, and ends this one
import numpy as np, fast_simplification
given = np.load(io.BytesIO(sys.stdin.buffer.read()))
points, triangles = fast_simplification.simplify(
    given["points"], given["triangles"], target_count=int(given["count"]), preserve_border=bool(given["borders"])
)
np.savez(sys.stdout.buffer, points=points, triangles=triangles)
"""


def library_is_there() -> bool:
    """Tell if edges can be collapsed."""
    return find_spec(LIBRARY) is not None


def collapsed(points: FloatArray, triangles: IntArray, count: int, *, borders: bool) -> tuple[FloatArray, IntArray]:
    """Return about ``count`` triangles in the place of more.

    Parameters
    ----------
    points : (V, 3) array
        Corners. [m]
    triangles : (T, 3) int array
        Into the corners.
    count : int
        Of the result.
    borders : bool
        Open borders stay as they are.

    Returns
    -------
    (W, 3) array, (count, 3) int array
        Corners [m], and triangles of them.

    Raises
    ------
    SimulationError
        If the library fails.
    """
    given = io.BytesIO()
    np.savez(given, points=points, triangles=triangles.astype(np.int32), count=count, borders=borders)
    done = subprocess.run([sys.executable, "-c", WORK], input=given.getvalue(), capture_output=True, check=False)
    if done.returncode != 0:
        last = done.stderr.decode(errors="replace").strip().splitlines()[-1:]
        raise SimulationError(
            f"{len(triangles):,} facets cannot be simplified to {count:,}: {''.join(last) or 'the library ended'}; "
            "give a mesh with fewer facets"
        )
    with np.load(io.BytesIO(done.stdout)) as found:
        return found["points"].astype(np.float64), found["triangles"].astype(np.intp)
