"""Pictures of a plan: what is wanted in cd/m², and how near each strategy comes to it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rig import plug_ins
from rig.errors import UsageError
from rig.files.photographs import PHOTOGRAPHS, photograph
from rig.files.pictures import PictureLevels, fitted, read_picture_in_channels
from rig.plan.light import LitRoom
from rig.plan.measures import checker
from rig.plan.records import PlannedPicture, StrategyOutcome, UnreachedPart
from rig.stages.target import check_strategies
from sim.compensation import Compensation, compensate
from sim.errors import SimulationError

FloatArray = NDArray[np.float64]

WHITE = 255.0
"""Grey levels of the white that is wanted."""
GREY = 70.0
"""Of the paper's uniform picture."""
VISIBLE = 0.02
"""Of the white wanted: what is missed by more counts as not reached."""
BOUNDED = "bounded"


@dataclass(frozen=True, eq=False, kw_only=True)
class PictureInRoom:
    """A picture and what is seen of it; (n,) arrays in the projector's view."""

    record: PlannedPicture
    wanted_cdm2: FloatArray
    projected: dict[str, FloatArray]
    """Projector image by strategy, 1 = white."""
    seen_cdm2: dict[str, FloatArray]


def picture_levels(name: str, shape: tuple[int, int]) -> FloatArray:
    """Return a picture's linear light (H, W), 255 = white.

    Parameters
    ----------
    name
        ``outdoor``, ``indoor``, ``grey``, ``grey:SHARE``, ``white``, ``checker``, or a picture file.
    shape
        (height, width); a file is scaled and cropped.

    Raises
    ------
    UsageError
        For a name that is no picture.
    """
    word, _, share = name.partition(":")
    if word in PHOTOGRAPHS and not share:
        return _photograph(word, shape)
    if name == "checker":
        return np.where(checker(shape), WHITE, 0.0)
    if word in ("grey", "white"):
        return np.full(shape, _grey_level(name, word, share))
    levels = _from_file(name).levels
    fitting = levels if levels.shape[:2] == shape else fitted(levels, shape)
    return np.asarray(fitting, dtype=np.float64)[..., 0]


def colours_told(names: tuple[str, ...]) -> list[str]:
    """Return a sentence of each picture file whose own colour space was made sRGB."""
    read = [(Path(name).name, _from_file(name).profile) for name in names if Path(name).is_file()]
    return [f"{name} is taken as {profile}." for name, profile in read if profile]


def _from_file(name: str) -> PictureLevels:
    """A grey picture of a file, of its own size; read anew where the file has changed."""
    path = Path(name)
    if not path.is_file():
        there = ", ".join((*PHOTOGRAPHS, "grey", "grey:0.5", "white", "checker"))
        raise UsageError(f"show.pictures: {name!r} is neither a file nor one of {there}; correct the name")
    state = path.stat()
    return _read_once(path, state.st_mtime_ns, state.st_size)


@lru_cache(maxsize=4)
def _read_once(path: Path, _changed_ns: int, _size: int) -> PictureLevels:
    """A search shows a picture again and again."""
    read = read_picture_in_channels(path, channels=1)
    read.levels.flags.writeable = False
    return read


@lru_cache(maxsize=8)
def _photograph(name: str, shape: tuple[int, int]) -> FloatArray:
    """A photograph, kept: a search shows it again and again."""
    levels = photograph(name, shape)
    levels.flags.writeable = False
    return levels


def _grey_level(name: str, word: str, share: str) -> float:
    if not share:
        return WHITE if word == "white" else GREY
    try:
        level = float(share)
    except ValueError:
        level = -1.0
    if not 0 < level <= 1:
        raise UsageError(f"show.pictures: {name!r}: give a share of white, e.g. grey:0.5")
    return WHITE * level


def checked_strategies(names: tuple[str, ...]) -> tuple[str, ...]:
    """Return the strategies to compute: none first, bounded always. Raises UsageError for an unknown one."""
    plug_ins.own_strategies()
    return check_strategies(tuple(dict.fromkeys((*names, BOUNDED))))


def picture_in_room(lit: LitRoom, name: str, white_cdm2: float, strategies: tuple[str, ...]) -> PictureInRoom:
    """Return a picture in a room: wanted, projected and seen, on the absolute scale of the white that is wanted.

    Parameters
    ----------
    lit
        The room.
    name
        As :func:`picture_levels` takes it.
    white_cdm2
        Luminance that white shall have. [cd/m²]
    strategies
        From :func:`checked_strategies`.
    """
    share = lit.pictures(partial(picture_levels, name)) / WHITE
    wanted = np.where(lit.lit, share * white_cdm2, 0.0)
    # A pixel that meets nothing cannot be seen: it is wanted to be as it is.
    target = np.where(lit.lit, lit.to_units(wanted), 0.0)
    solved = {one: solve(lit, one, target) for one in strategies}
    seen = {one: lit.from_units(found.predicted) + lit.unstoppable_cdm2 for one, found in solved.items()}
    outcomes = tuple(
        _outcome(lit, one, solved[one], missed_cdm2=seen[one] - wanted, white_cdm2=white_cdm2) for one in strategies
    )
    record = PlannedPicture(
        name=Path(name).name,
        wanted_mean_cdm2=float(wanted[lit.lit].mean()),
        global_share=_global_share(lit, solved["none"].projector_image),
        strategies=outcomes,
        optimum_gap=float(solved[BOUNDED].notes["gap"]),
        unreached=unreached_parts(lit, seen[BOUNDED] - wanted, white_cdm2),
    )
    return PictureInRoom(
        record=record,
        wanted_cdm2=wanted,
        projected={one: found.projector_image for one, found in solved.items()},
        seen_cdm2=seen,
    )


def solve(lit: LitRoom, strategy: str, target: FloatArray) -> Compensation:
    """Return what a strategy projects for a target (n,) in the light model's unit, between black and white."""
    try:
        return compensate(strategy, lit.transport, target, lower=lit.black, upper=1.0)
    except SimulationError as error:
        raise UsageError(f"strategy {strategy}: {error}") from error


def _outcome(
    lit: LitRoom, strategy: str, found: Compensation, *, missed_cdm2: FloatArray, white_cdm2: float
) -> StrategyOutcome:
    missed = np.abs(missed_cdm2[lit.lit])
    rms = float(np.sqrt(np.mean(missed**2)))
    scale = WHITE / white_cdm2
    gain = found.notes.get("gain")
    return StrategyOutcome(
        strategy=strategy,
        error=float(missed.mean()) * scale,
        rms=rms * scale,
        max=float(missed.max()) * scale,
        error_cdm2=float(missed.mean()),
        psnr_db=float(20 * np.log10(white_cdm2 / max(rms, 1e-9 * white_cdm2))),
        clipped_share=float(found.clipped[lit.lit].mean()),
        gain=None
        if strategy != "none" or not isinstance(gain, float)
        else gain * white_cdm2 * np.pi / lit.lux_per_unit,
    )


def _global_share(lit: LitRoom, projected: FloatArray) -> float:
    all_light = float(np.asarray(lit.transport @ projected).sum())
    return float(np.asarray(lit.transport.global_ @ projected).sum()) / all_light if all_light > 0 else 0.0


def unreached_parts(lit: LitRoom, error_cdm2: FloatArray, white_cdm2: float) -> tuple[UnreachedPart, ...]:
    """Return where an optimum misses what is wanted, by surface; surfaces without such places are left out."""
    of_pixel = np.where(lit.lit, lit.room.shape.surface_of[lit.hits.patch], -1)
    parts = []
    for k, name in enumerate(lit.room.shape.names):
        inside = of_pixel == k
        area, error = lit.footprints_m2[inside], error_cdm2[inside]
        dark, bright = (float(area[side * error > VISIBLE * white_cdm2].sum()) for side in (-1, 1))
        if dark or bright:
            mean = float((area * error).sum() / area.sum())
            parts.append(UnreachedPart(surface=name, too_dark_m2=dark, too_bright_m2=bright, mean_cdm2=mean))
    return tuple(parts)
