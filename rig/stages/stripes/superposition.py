"""Whether light adds up: pictures of a code make white with their inverses, unless a device changes bright ones."""

from __future__ import annotations

import numpy as np

from calibration.structured_light.consistency.complements import superposition_error
from rig.records import Verdict
from rig.stages.stripes.reading import INVERSE, has_inverses, in_light, some_pixels, swell_of
from rig.stages.stripes.showing import CodePhotographs
from rig.stages.stripes.width import ShownCode

_PAIRS = 6
"""So many, from wide stripes to narrow ones, tell as much as all do: what a dimmed white lacks, it lacks of each."""
_MOST_PERCENT = 1.0
"""84 random rigs have 0.35 % at most; a camera that maps tones locally 1.6, a projector that dims white by 15 % 9."""


def superposition_percent(by: CodePhotographs, shown: ShownCode) -> float | None:
    """Return by how many per cent of white patterns have more light with their inverses than white has.

    None where the code has no inverses, or too little is lit.
    """
    names = shown.code.pattern_names(by.profile.projector.shape)
    if not has_inverses(names):
        return None
    flats, frame = (by.frame("white"), by.frame("black")), by.of(shown)
    reading, some = in_light(flats, by.radiometric), some_pixels(flats[0].shape)
    patterns = [name for name in names if not name.endswith(INVERSE)]
    chosen = np.unique(np.linspace(0, len(patterns) - 1, _PAIRS).round().astype(int))
    pairs = [
        (reading.read(frame(patterns[k])[some]), reading.read(frame(f"{patterns[k]}{INVERSE}")[some])) for k in chosen
    ]
    error = superposition_error(
        pairs,
        reading.white[some],
        reading.black[some],
        noise_limit=reading.noise_limit[some],
        saturation=reading.saturation,
        swell=swell_of(by.radiometric),
    )
    return None if error is None else 100 * error


def superposition_verdicts(percent: float | None) -> tuple[Verdict, ...]:
    """Return what is judged of light that does not add up; nothing where nobody could tell."""
    if percent is None:
        return ()
    return (
        Verdict(
            what="superposition: white against pictures and their inverses together",
            value=abs(percent),
            limit=_MOST_PERCENT,
            unit="% of white",
            advice=(
                "white has less light than the pictures that make it up: the projector dims bright pictures (dynamic "
                "iris or lamp, eco mode, power limit), or the camera brightens dark ones (tone mapping, dynamic range "
                "or shadow correction, automatic gain)"
                if percent > 0
                else "white has more light than the pictures that make it up: the projector brightens bright pictures "
                "(dynamic contrast, white boost), or the camera's gain is automatic"
            )
            + ": switch that off, and begin a new session",
        ),
    )
