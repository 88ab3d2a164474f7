"""What a profile says of a GenICam camera beyond what all cameras have: its table [camera.options]."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import Field, ValidationError

from rig.errors import ProfileError
from rig.files.toml import Table

Value = bool | int | float | str


class GenicamOptions(Table):
    """The table [camera.options] of driver ``genicam``."""

    trigger: Literal["software", "free", "line"] = "software"
    """``software``: a frame is exposed when one is asked for; ``free``: all the time; ``line``: at each pulse of a
    wire, the projector's sync output for one."""
    line: str = "Line0"
    """The input of the wire, as the camera calls it."""
    activation: str = "RisingEdge"
    packet_size: Annotated[int, Field(ge=576, le=16384)] | None = None
    """Bytes, GigE; default: the largest that arrives."""
    packet_socket: bool = True
    """Whether packets may be taken from the network card itself, past firewalls, where this program has the right
    to (root); false: through an ordinary socket, for cards on which nothing comes that way."""
    features: Mapping[str, Value] = Field(default_factory=dict)
    """Further features by the names of the camera, set last, and read back."""


def options_of(options: Mapping[str, object]) -> GenicamOptions:
    """Return validated options. Raises ProfileError, with a line for each problem."""
    try:
        return GenicamOptions.model_validate(dict(options))
    except ValidationError as error:
        lines = [f"camera.options.{'.'.join(map(str, one['loc']))}: {one['msg']}" for one in error.errors()]
        raise ProfileError("\n".join(lines)) from error
