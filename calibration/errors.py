"""The one error of this package."""

from __future__ import annotations


class CalibrationError(Exception):
    """The arrays handed in do not determine what was asked for; the message says what to try."""
