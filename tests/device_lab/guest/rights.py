"""What another user may do."""

import os
from collections.abc import Iterator
from contextlib import contextmanager

NOBODY = 65534


@contextmanager
def as_nobody() -> Iterator[None]:
    """Another user's rights, for opening files."""
    os.seteuid(NOBODY)
    try:
        yield
    finally:
        os.seteuid(0)
