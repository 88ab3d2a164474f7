"""How often each Gray code is misread in the closed, bright simulated room.

    python benchmarks/calibration/gray_codes.py [PROFILE]

Both codes are photographed on the same simulated rig (noise, blur, interreflection) and decoded with the same
limits; every pixel that the decoder calls valid is compared with the projector pixel that the
simulated world's geometry says.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.structured_light.decode import decode_gray
from calibration.structured_light.gray import CodeName, gray_code_patterns
from calibration.structured_light.patterns import flat
from rig import Rig, open_rig
from rig.devices.simulated.devices import SimulatedCamera
from rig.devices.simulated.optics import directions, pixels_of
from rig.devices.simulated.room import trace
from rig.devices.simulated.world import SimulatedWorld

FloatArray = NDArray[np.float64]
_SIGMAS = 2.0
_WRONG_PX = 2.0


@dataclass(frozen=True)
class Reading:
    """How well one code was read."""

    code: CodeName
    valid_share: float
    """Of the camera's pixels."""
    wrong_share: float
    """Of the valid ones: further than 2 projector pixels from the truth."""
    wrong_median_px: float
    worst_px: float


def read_code(rig: Rig, code: CodeName) -> Reading:
    """Photograph, decode, compare with the simulated world."""
    world = simulated_world_of(rig)
    shape = rig.projector.shape
    frames = {
        pattern.name: rig.shoot(pattern.codes, name=pattern.name).pixels[..., 0]
        for pattern in gray_code_patterns(shape, code=code)
    }
    white, black = (rig.shoot(flat(shape, c).codes, name=f"flat-{c}").pixels[..., 0] for c in (255, 0))
    limit = _SIGMAS * np.sqrt(2) * _noise_dn(rig, white, black)
    found = decode_gray(frames, shape, white=white, black=black, contrast_limit=limit, bit_limit=limit, code=code)
    error = np.linalg.norm(found.projector_xy_px - true_projector_xy(world), axis=-1)[found.valid]
    wrong = error > _WRONG_PX
    median = float(np.median(error[wrong])) if wrong.any() else 0.0
    return Reading(
        code=code,
        valid_share=float(found.valid.mean()),
        wrong_share=float(wrong.mean()),
        wrong_median_px=median,
        worst_px=float(error.max()),
    )


def simulated_world_of(rig: Rig) -> SimulatedWorld:
    """The truth behind a simulated rig."""
    if not isinstance(rig.camera, SimulatedCamera):
        raise SystemExit("only a simulated rig knows the truth; give a profile with driver = 'simulated'")
    if not isinstance(rig.camera.world, SimulatedWorld):
        raise SystemExit("only for a box; give a profile without simulation.scene")
    return rig.camera.world


def true_projector_xy(world: SimulatedWorld) -> FloatArray:
    """(H, W, 2) projector pixel that each camera pixel's centre sees, by the simulated world's own geometry."""
    height, width = world.camera.shape
    grid = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).astype(np.float64)
    surface = trace(world.room, world.camera.position_m, directions(world.camera, grid))
    return np.asarray(pixels_of(world.projector, surface.points_m))


def _noise_dn(rig: Rig, white: NDArray[np.uint16], black: NDArray[np.uint16]) -> FloatArray:
    """(H, W) standard deviation of a half-lit frame, from the simulated world's sensor."""
    sensor = simulated_world_of(rig).settings.camera
    gain = sensor.full_well_e / (rig.camera.full_scale_dn - sensor.black_level_dn)
    level = np.maximum((white / 2 + black / 2) - sensor.black_level_dn, 0)
    return np.asarray(np.sqrt(level / gain + (sensor.read_noise_e / gain) ** 2 + 1 / 12))


def expose(rig: Rig, aim: float = 0.85) -> None:
    """Set the exposure so that white stays just below saturation."""
    exposure_s = rig.profile.camera.exposure_s
    for _ in range(10):
        white = rig.shoot(flat(rig.projector.shape, 255).codes, name="white", exposure_s=exposure_s).pixels
        level = float(np.quantile(white, 0.999)) / rig.camera.full_scale_dn
        if abs(level - aim) < 0.1 * aim:
            return
        shortest, longest = rig.camera.exposure_range_s
        factor = 0.25 if level > 0.98 else aim / max(level, 0.01)
        exposure_s = float(np.clip(exposure_s * factor, shortest, longest))


def main(profile: str = "sim-room") -> None:
    """Print a line for each code."""
    with open_rig(profile) as rig:
        expose(rig)
        print(f"{profile}: valid = share of all camera pixels; wrong = share of the valid, beyond {_WRONG_PX:g} px")
        for code in ("gray", "long-run"):
            r = read_code(rig, code)
            print(
                f"{code:9} valid {100 * r.valid_share:5.1f} %  wrong {100 * r.wrong_share:5.2f} %  "
                f"median of the wrong {r.wrong_median_px:6.1f} px  worst {r.worst_px:6.1f} px"
            )


def parsed() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("profile", nargs="?", default="sim-room", help="a profile's name or file: sim-room")
    return parser.parse_args()


if __name__ == "__main__":
    main(parsed().profile)
