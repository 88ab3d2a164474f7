"""Options and arguments that several verbs share, once each, and how a result is printed for programs."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Protocol

from cyclopts import Parameter

from rig.records import JsonObject, json_of
from rig.run import request

ProfileOption = Annotated[
    str | None,
    Parameter(name=["--profile", "-p"], help="Profile file or name; needed once, then the session keeps its copy."),
]
SessionFolder = Annotated[Path, Parameter(help="Folder of the session; made if it does not exist.")]
Target = Annotated[
    Path | None,
    Parameter(
        help="Picture to show (PNG, JPEG, TIFF, EXR), or default: a test picture. Without it the session's last one."
    ),
]
Linear = Annotated[
    bool,
    Parameter(name="--linear", negative="", help="The target's codes are linear light; default: sRGB (EXR is linear)."),
]
Fit = Annotated[
    bool, Parameter(name="--fit", negative="", help="Scale and crop a target of another size to the projector's.")
]
Strategies = Annotated[
    str,
    Parameter(
        name=["--strategies", "--strategy"],
        help="Strategies to project, separated by commas, or all: none, direct, paper, exact, reverse_radiosity, "
        "block_fixed_point, tikhonov, series, dual, bounded, perceptual, remap, content_scale, smooth_attenuation; "
        "rig devices lists those of other packages, too.",
    ),
]
DEFAULT_STRATEGIES = ",".join(request.DEFAULT_STRATEGIES)
Json = Annotated[bool, Parameter(name="--json", negative="", help="Print the result as JSON.")]


class HasJson(Protocol):
    """A result that can be written as JSON."""

    def as_json(self) -> JsonObject:
        """The result as one JSON object."""
        ...


def print_json(result: HasJson | Mapping[str, object]) -> None:
    """Print a result on stdout, for programs."""
    value = json_of(result) if isinstance(result, Mapping) else result.as_json()
    print(json.dumps(value, indent=2, allow_nan=False))


def names_of(text: str) -> tuple[str, ...]:
    """Return the words of a list that is separated by commas."""
    return tuple(name.strip() for name in text.split(","))
