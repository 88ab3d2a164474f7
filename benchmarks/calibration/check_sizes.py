"""How far direct and global light are off by checks of each size, in random rigs' worlds without noise.

    python benchmarks/calibration/check_sizes.py 7202 7001 --effects corner-blur lamp tone 8-bit
    python benchmarks/calibration/check_sizes.py 5106 7104 7103 7102

Rigs are those of `random_rigs.py` with the same seeds and effects. Frames are the light on the simulated sensor,
places what a code of usual noise finds: what is left is the method's own error, from lenses whose blur is no Gaussian,
and from light of other walls that changes from check to check. The ratio is that of a check and the picture's blur, by
these checks. The code's stripes have to tell that blur before, from one noisy frame each: `--noise` is of white.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from geometry_worlds import CodeNoise, box, exact_map, measured
from numpy.typing import NDArray
from random_profiles import EFFECTS, rig_of

from calibration.light.blur import fit_point_spread
from calibration.light.check_size import blur_of_picture_px, stripes_that_tell
from calibration.light.separation import separate_by_pattern
from calibration.structured_light.correspondence import Correspondence
from calibration.structured_light.gray import gray_code_patterns
from calibration.structured_light.patterns import checker_patterns
from rig.devices.simulated.rigs import simulated_worlds_of
from rig.devices.simulated.world import SimulatedWorld
from rig.profile.schema import load_profile

Image = NDArray[np.float32]
SHIFTS = 25
LIT = 0.05
"""Of the median direct light: darker pixels count as little as their share of the means."""


@dataclass(frozen=True)
class Bias:
    """Of the means over all lit pixels that were separated."""

    blur_px: float
    direct_percent: float
    global_percent: float
    separated_share: float


@dataclass(frozen=True)
class SeenWorld:
    """A rig's world as a camera without noise sees it."""

    world: SimulatedWorld
    correspondence: Correspondence

    def light(self, codes: NDArray[np.uint8]) -> Image:
        """On the sensor."""
        return self.world.through_lens(self.world.light(codes).total)

    def above_black(self, codes: NDArray[np.uint8]) -> Image:
        """What a picture adds to black."""
        return self.light(codes) - self.light(np.zeros_like(codes))

    def bias(self, size_px: int) -> Bias:
        """Separate by checks of one size."""
        shape, found = self.world.projector.shape, self.correspondence
        patterns = [pattern.codes for pattern in checker_patterns(shape, size_px, SHIFTS)]
        frames = [self.above_black(codes) for codes in patterns]
        full = np.full(shape, 255, np.uint8)
        white, black = self.world.light(full), self.world.light(np.zeros_like(full))
        direct, global_ = (
            (a - b) * self.world.vignetting for a, b in ((white.direct, black.direct), (white.global_, black.global_))
        )
        spread = fit_point_spread(frames, patterns, found, found.valid)
        split = separate_by_pattern(frames, patterns, found, white=self.above_black(full), spread=spread)
        lit = found.valid & (direct > LIT * np.median(direct[found.valid]))
        told = lit & split.valid
        return Bias(
            blur_px=blur_of_picture_px(spread, found, lit),
            direct_percent=100 * float(split.direct[told].mean() / direct[told].mean() - 1),
            global_percent=100 * float(split.global_[told].mean() / global_[told].mean() - 1),
            separated_share=float(told.sum() / lit.sum()),
        )

    def blur_by_stripes_px(self, noise_share: float) -> float:
        """What the code's stripes tell, with noise of so much of the brightest light."""
        shape, found = self.world.projector.shape, self.correspondence
        stripes = stripes_that_tell(list(gray_code_patterns(shape)))
        white = self.above_black(np.full(shape, 255, np.uint8))
        random = np.random.default_rng(self.world.settings.seed)
        sigma = noise_share * float(np.quantile(white, 0.98))
        frames = [self.above_black(p.codes) + random.normal(0, sigma, white.shape).astype(np.float32) for p in stripes]
        lit = found.valid & (white > LIT * np.median(white[found.valid]))
        return blur_of_picture_px(fit_point_spread(frames, [p.codes for p in stripes], found, lit), found, lit)


def seen_world(seed: int, effects: Sequence[str]) -> SeenWorld:
    """Of one random rig."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "rig.toml"
        path.write_text(rig_of(seed, effects), "utf-8")
        world = simulated_worlds_of(load_profile(path))[0]
    if not isinstance(world, SimulatedWorld):
        raise SystemExit("random rigs stand in boxes")
    exact = exact_map(box(np.array(world.settings.size_m)), world.camera, world.projector)
    return SeenWorld(world, measured(exact, world.projector.shape, CodeNoise(), world.settings.seed))


def main(given: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("seeds", type=int, nargs="+")
    parser.add_argument("--effects", nargs="*", choices=EFFECTS, default=[])
    parser.add_argument("--noise", type=float, default=0.01)
    parser.add_argument("--sizes", type=int, nargs="+", default=[8, 10, 12, 16, 20])
    arguments = parser.parse_args(given)
    print(" seed  check px  blur px  ratio  direct %  global %  separated")
    for seed in arguments.seeds:
        world = seen_world(seed, arguments.effects)
        print(f"{seed:5d}  stripes  {world.blur_by_stripes_px(arguments.noise):8.2f}", flush=True)
        for size_px in arguments.sizes:
            one = world.bias(size_px)
            print(
                f"{seed:5d}  {size_px:8d}  {one.blur_px:7.2f}  {size_px / one.blur_px:5.1f}  "
                f"{one.direct_percent:8.2f}  {one.global_percent:8.2f}  {one.separated_share:9.3f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
