"""Curves of simulated cameras with many tone curves against the truth, from frames of one still picture alone.

    python benchmarks/calibration/tone_curves.py --cameras 120 --seed 11

Straight sensors, powers, sRGB, Rec. 709, S curves on each of these, and shoulders; 8 and 12 bits. Light is judged as
by `response_coverage.py`, which takes whole simulated rigs: error over stated standard error, and relative error.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from response_coverage import JUDGED

from calibration.errors import CalibrationError
from calibration.radiometry.camera_response import fit_camera_response
from calibration.radiometry.response import light_of_levels
from rig.devices.simulated.devices import toned

Array = NDArray[np.float64]
Tone = Callable[[Array], Array]
PIXELS = 8000
SWEEP = np.repeat([1 / 32, 1 / 16, 1 / 8, 1 / 4, 1 / 2, 0.75, 1.0, 1.15, 1.35, 1.7, 2.2], 2)
SHORT_SWEEP = np.repeat([1 / 32, 1 / 16, 1 / 8, 1 / 4, 1 / 2, 0.75, 1.0, 1.3], 2)
"""Exposures over the one at which the brightest pixels are at about 0.8 of full scale."""


class Camera(NamedTuple):
    """Of full scale 1."""

    kind: str
    tone: Tone
    bits: int
    black_dn: float
    full_well_e: float
    read_noise_e: float


def rec709(light: Array) -> Array:
    """ITU-R BT.709."""
    return np.where(light < 0.018, 4.5 * light, 1.099 * np.maximum(light, 1e-12) ** 0.45 - 0.099)


def tones(random: np.random.Generator) -> dict[str, Tone]:
    """One of each kind."""
    share, power, bent = random.uniform(0.05, 0.35), 1 / random.uniform(1.8, 2.4), random.uniform(0, 1)
    wide = random.uniform(1 / 3, 1 / 0.45)

    def saturated(light: Array, by: float) -> Array:
        return light * (1 + by) / (1 + by * light)

    def camera(tone: str | float, s_shape: float = 0.0) -> Tone:
        return lambda light: toned(light.astype(np.float32), tone, s_shape).astype(np.float64)

    return {
        "straight": lambda light: saturated(light, 0.1 * bent),
        "power": camera(1 / wide),
        "sRGB": camera("srgb"),
        "Rec. 709": rec709,
        "S": camera("linear", share),
        "S on sRGB": camera("srgb", share),
        "S on power": camera(1 / power, share),
        "shoulder": lambda light: camera("srgb")(saturated(light, bent)),
    }


def drawn(number: int, random: np.random.Generator) -> Camera:
    """Draw a camera; kinds take turns."""
    kinds = tones(random)
    kind = list(kinds)[number % len(kinds)]
    bits = int(random.choice([8, 12]))
    black_dn = random.uniform(0.5, 3) if bits == 8 else random.uniform(30, 90)
    return Camera(kind, kinds[kind], bits, black_dn, random.uniform(8e3, 3e4), random.uniform(2, 8))


def frames(camera: Camera, sweep: Array, random: np.random.Generator) -> Array:
    """(F, N) levels above black."""
    light = np.clip(np.exp(random.normal(-1, 0.5, PIXELS)), 0.05, 1)
    places = np.linspace(0, 1, 4001)
    light *= np.interp(random.uniform(0.74, 0.84), camera.tone(places), places) / np.quantile(light, 0.999)
    changes = random.normal(0, random.choice([1e-5, 3e-4]), len(sweep))
    expected = np.outer(sweep * (1 + changes), light) * camera.full_well_e
    electrons = random.poisson(expected) + random.normal(0, camera.read_noise_e, expected.shape)
    y = np.clip(camera.tone(np.clip(electrons / camera.full_well_e, 0, 1)), 0, 1)
    full_scale_dn = 2**camera.bits - 1
    return np.asarray(np.rint(camera.black_dn + (full_scale_dn - camera.black_dn) * y) - camera.black_dn)


def judged(camera: Camera, sweep: Array, random: np.random.Generator) -> tuple[Array, Array]:
    """Relative errors of light, and errors over stated standard errors."""
    top = 2**camera.bits - 1 - camera.black_dn
    found = fit_camera_response(frames(camera, sweep, random), sweep, top, black_dn=camera.black_dn)
    if found.sigma is None:
        raise CalibrationError("no standard errors")
    at = top * camera.tone(JUDGED)
    error = light_of_levels(found, at) - JUDGED
    return error / JUDGED, error / np.interp(at, found.levels, found.sigma)


def line_of(kind: str, each: list[tuple[Array, Array]]) -> str:
    """Tell of the cameras of a kind."""
    errors, scores = (np.abs(np.array(one)) for one in zip(*each, strict=True))
    median, p90 = 100 * np.quantile(errors, [0.5, 0.9])
    return (
        f"{kind:12s}{len(each):5d}{np.median(scores) / 0.6745:9.2f}{np.sqrt((scores**2).mean()):8.2f}"
        f"{(scores < 3).mean():10.3f}{scores.max():8.2f}{median:9.3f}{p90:8.3f}"
    )


def main() -> int:
    """Fit random cameras and print how far off they are."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cameras", type=int, default=120)
    parser.add_argument("--seed", type=int, default=11)
    parser.add_argument("--short", action="store_true", help="exposures up to 1.3 only")
    wanted = parser.parse_args()
    found: dict[str, list[tuple[Array, Array]]] = {}
    for number in range(wanted.cameras):
        random = np.random.default_rng([wanted.seed, number])
        camera = drawn(number, random)
        try:
            one = judged(camera, SHORT_SWEEP if wanted.short else SWEEP, random)
        except CalibrationError as error:
            print(f"{number} {camera.kind}, {camera.bits} bits: {error}")
            continue
        found.setdefault(camera.kind, []).append(one)
        if np.abs(one[1]).max() > 3:
            print(f"{number} {camera.kind}, {camera.bits} bits: {np.round(one[1], 1)}", flush=True)
    print("kind            n  typical     rms  within 3     max  error %     p90")
    for kind, each in found.items():
        print(line_of(kind, each))
    print(line_of("all", [one for each in found.values() for one in each]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
