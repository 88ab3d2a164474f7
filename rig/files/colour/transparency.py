"""Pictures that let something shine through."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.errors import UsageError


def check_opaque(path: Path, alpha: NDArray[Any]) -> None:
    """Refuse a picture of which a part is transparent: what is to be seen there, nobody said.

    Numbers with a point (EXR) come multiplied by the transparency, which is the light over black: they are taken.

    Parameters
    ----------
    path
        Of the file.
    alpha
        (H, W) opacity, as the file has it.

    Raises
    ------
    UsageError
        A pixel is not opaque.
    """
    if alpha.dtype.kind != "u":
        return
    clear = float((alpha < np.iinfo(alpha.dtype).max).mean())
    if clear:
        raise UsageError(
            f"{path}: {clear:.2%} of its pixels are transparent, wholly or in part, and a projector has nothing behind "
            "them; flatten the picture on the colour that is wanted there (black: no light), and export it again"
        )
