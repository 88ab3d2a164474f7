"""What is asked of a session, as the command line or a script says it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # the command line begins with this file
    from rig.profile.target_table import TargetTable

DEFAULT_STRATEGIES = ("none", "direct", "paper", "exact", "bounded")
"""Strategies that a session shows unless others are named."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionRequest:
    """A session, and what is to be shown in it."""

    folder: str | Path
    """Of the session; made if it does not exist."""
    profile: str | Path | None = None
    """File, or the bare name of one in ``hw_profiles``; None: the copy that the session has."""
    target: str | Path | None = None
    """Picture to show; None: the session's last one, in a new session (or as ``default``) a photograph that ships with
    scikit-image."""
    fit: bool = False
    """Scale and crop a target of another size to the projector's."""
    linear: bool = False
    """The target's codes are linear light; else sRGB."""
    place: TargetTable | None = None
    """Where the target is wanted; None: where the profile's ``[target]`` says."""
    strategies: tuple[str, ...] = DEFAULT_STRATEGIES
    """Names of compensation strategies, or ``all``."""
