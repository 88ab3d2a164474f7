"""Pictures worked on some rows at a time, on several threads: what a strip needs stays in the cache."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor

import cv2

_STRIP_PIXELS = 1 << 17
"""Of bytes, seven planes of so many are in use at a time, which the second-level cache nearly holds; of smaller strips,
calls and threads that wait for each other take more than is saved (measured on two cores with 1 MiB each)."""


def for_each_strip(work: Callable[[slice], None], shape: tuple[int, int], pixels: int = _STRIP_PIXELS) -> None:
    """Call a function for strips of rows that together are the picture, on as many threads as OpenCV may use.

    Parameters
    ----------
    work : callable (rows)
        Reads and writes the rows of a slice, and nothing that another call writes.
    shape : (height, width)
        Of the picture. [px]
    pixels : int
        About as many in a strip.
    """
    strips = list(_strips(shape, pixels))
    threads = min(cv2.getNumThreads(), len(strips))
    if threads < 2:
        for rows in strips:
            work(rows)
        return
    with ThreadPoolExecutor(threads) as executor:
        list(executor.map(work, strips))


def _strips(shape: tuple[int, int], pixels: int) -> Iterator[slice]:
    rows = max(1, pixels // max(shape[1], 1))
    return (slice(first, min(first + rows, shape[0])) for first in range(0, shape[0], rows))
