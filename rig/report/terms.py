"""What the words of tables and pages mean, each in one sentence: pages show it where a pointer rests on the word."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

STRATEGIES: Mapping[str, str] = {
    "none": "The target at the single gain that makes its mean error smallest: nothing is compensated.",
    "direct": "Each pixel by its own brightness; light between the walls is left out.",
    "paper": "The rule of Dehos et al. 2014, which takes the light between the walls off.",
    "exact": "The inverse of the light transport, clipped to what the projector can show.",
    "bounded": "The picture between black and white whose squared error is smallest.",
    "reverse_radiosity": "The radiosity equation solved backwards, patch by patch.",
    "block_fixed_point": "The light between the walls taken off again and again, in blocks.",
    "tikhonov": "A least-squares inverse that is held back where noise would grow.",
    "series": "The inverse as a sum over bounces, cut off after some.",
    "dual": "The optimum between black and white, found from its dual problem.",
    "perceptual": "Errors weighed as eyes weigh them, between black and white.",
    "remap": "The target's range made narrower until all of it can be shown.",
    "content_scale": "The target darkened until all of it can be shown.",
    "smooth_attenuation": "The target darkened smoothly where it cannot be shown.",
}
"""By name, as the command line knows them."""
WORDS: Mapping[str, str] = {
    "strategy": "The rule that computes what the projector shows; named as on the command line.",
    "mean": "Mean of |shown - target| over the judged pixels, in grey levels of 255.",
    "measured mean": "Mean of |photographed - target| over the judged pixels, in grey levels of 255.",
    "predicted mean": "The same of what the model expects the camera to see.",
    "sd": "Standard deviation of |shown - target|.",
    "max": "Largest |shown - target|.",
    "rms": "Root mean square: large errors weigh more than in the mean.",
    "predicted rms": "Root mean square error of what the model expects the camera to see.",
    "bias": "Mean of shown - target: above 0 too bright.",
    "SSIM": "Structural similarity (Wang et al. 2004): 1 is the same picture.",
    "ΔE": "Mean colour difference CIEDE2000: 1 is just seen.",
    "mean at best gain": "Mean error after the one gain that suits best: what an eye that adapts is left with.",
    "clipped, %": "Share of the driven projector pixels that their range, black to white, holds back.",
    "clipped %": "Share of the driven projector pixels that their range, black to white, holds back.",
    "iterations": "Steps that the strategy's solver took.",
    "gain": "What the strategy scales the target by.",
    "time s": "Seconds to compute the projector image.",
    "captures": "Photographs that a closed loop took.",
    "contrast": "Mean light where white is wanted over that where black is.",
    "within 3 σ, %": "Pixels within three standard deviations of noise and model: 99.7 if both are known well.",
    "noise rms": "What the photograph's noise alone makes of the difference.",
    "frame": "A photograph: of a strategy's picture, or of one that nothing was fitted to (held-out).",
    "limit": "From the profile's [limits], or from what the method needs.",
    "expected": "The range that this rig's own noise and geometry let one expect.",
    "target": "The picture that is wanted, as the camera should see it.",
    "projected": "The codes that were sent to the projector.",
    "predicted": "What the model expects the camera to see.",
    "measured": "What the camera saw, in linear light on the target's scale.",
    "error": "Measured minus target: blue too dark, red too bright.",
    "measured - target": "Blue too dark, red too bright.",
    "predicted - target": "Blue too dark, red too bright.",
    "geometry: reprojection rms": "How far the fitted lenses and walls miss the places where pixels were seen.",
    "geometry: uncertainty of the room's lengths": "Standard deviation of the least certain length, tape included.",
    "geometry: uncertainty of the places of devices and surfaces": (
        "Standard deviation of where the least certain device or measured wall is, of the room's longest side."
    ),
    "geometry: what the least certain length or place is off by, once in a hundred": (
        "2.58 of its standard deviations: so much, or more, in one rig of a hundred that state these."
    ),
    "geometry: what points and fields of view say against right angles": (
        "A fit without right angles explains them better by so many standard deviations; 4 are refused."
    ),
    "geometry: what the least certain length or place is off by, if walls are 0.3° askew": (
        "Right angles that the profile promises are taken as exact; this is what rests on them, beside the "
        "uncertainty. With surface.askew_deg they are not, and it is part of the uncertainty."
    ),
    "geometry: directions in which a wall's place is guessed": "Along these nobody saw or measured where walls are.",
    "stripes of the code, wider than usual": "The lenses blur the code's own stripes away: places are rougher.",
    "superposition: white against pictures and their inverses together": (
        "Light adds up, whatever a room does with it: where it does not, a device changes bright pictures or dark ones."
    ),
    "valid share of the lit pixels": "Lit camera pixels for which the projector pixel is known.",
    "model: global light left unexplained, rms": "Light between the walls that no reflectance explains, relative.",
    "model: photographs of [transport], each by the others, rms": (
        "How far each photograph of a known picture is from what all the others make of it."
    ),
    "measured - simulated: rms": "Photograph minus prediction, on pictures that nothing was fitted to.",
    "measured - simulated: within 3 sigma, least of all pictures": (
        "Pixels that are off by no more than three of their stated standard deviations, in the picture with fewest."
    ),
    "measured - simulated: |bias|": "Mean of photograph minus prediction, whichever sign.",
    "geometry: how far the measured walls are off the box that stands for them": (
        "Distance of 95 % of the measured points from the box: large where a wall leans or a corner is not square."
    ),
    "separation: side of a check over the blur of the picture": (
        "In standard deviations of what a camera pixel sees of the picture: with few, no place of a check is without "
        "light of its neighbours."
    ),
    "separation: direct light by the middles of checks, against that by all of them": (
        "A camera that sharpens its pictures, or a dirty lens, adds or takes light beside edges; none reach the middle."
    ),
    "separation: pictures of checks left out": "A few that the others contradict: somebody was in the light.",
    "photographs: light of the picture before": (
        "What is still there of white when black is photographed after it: 0 where photographs begin late enough."
    ),
    "lamp: drift of white": "How much of a change of projector white may be left in the light, or how fast it is.",
    "standing still: displacement of white between two photographs": (
        "By how far a photograph of white has to be moved to lie on an earlier one: 0 while nothing moves."
    ),
}
"""Heads of columns, and rows that are judged."""


UNITS: Mapping[str, str] = {"px": "px", "m": "m", "mm": "mm", "s": "s", "deg": "°", "percent": "%"}
"""As keys of results end, and as people write them."""
SPELT: Mapping[str, str] = {"rmse": "rms error", "focal": "focal length", "p95": "at the 95th percentile"}
"""Words of keys that are short for others."""


def name_of(key: str) -> str:
    """Return what a key of a result is called where people read it: ``focal_percent`` is ``focal length [%]``."""
    words = key.split("_")
    unit = UNITS.get(words[-1]) if len(words) > 1 else None
    named = " ".join(SPELT.get(word, word) for word in (words if unit is None else words[:-1]))
    return named if unit is None else f"{named} [{unit}]"


def explanation(word: str) -> str:
    """Return what a word means, empty where that needs no words."""
    return STRATEGIES.get(word) or WORDS.get(word) or STRATEGIES.get(word.partition(",")[0], "")


def explained(words: Iterable[str]) -> dict[str, str]:
    """Return the words that have an explanation, each once, with it."""
    return {word: text for word in words if (text := explanation(word))}
