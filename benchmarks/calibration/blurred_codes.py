"""How well each code is read behind blur, with stripes as they are and several times as wide.

    python benchmarks/calibration/blurred_codes.py [--blur 1 2 3 4.5] [--codes long-run gray] [--reflectance 0.5]

A closed simulated room, camera of 240 x 180 px, projector of 512 x 384 px; blur is the projector's standard deviation
in its pixels. `chosen` is the width that a session would choose, from photographs of stripes of two periods.
"""

from __future__ import annotations

import argparse
import sys

import cv2
import numpy as np

from calibration import CODES
from calibration.structured_light.stripe_width import StripeBlur, blur_of_stripes, blur_patterns, times_as_wide
from calibration.structured_light.wider import widened
from rig.benchmark.references.coded_room import CodedRoom, room_settings
from rig.devices.simulated.world import SimulatedWorld

CAMERA, PROJECTOR = (180, 240), (384, 512)


def room_behind(blur_px: float, reflectance: float) -> CodedRoom:
    """The closed room, its projector out of focus."""
    settings = room_settings(reflectance, CAMERA[1], PROJECTOR[1])
    blurred = settings.with_device(settings.projector.model_copy(update={"blur_px": blur_px}))
    return CodedRoom(SimulatedWorld(blurred, CAMERA, PROJECTOR))


def measured(room: CodedRoom) -> StripeBlur:
    """What the stripes of two periods tell."""
    frames = {name: frame.astype(np.float32) for name, frame in room.photographs(blur_patterns(PROJECTOR)).items()}
    white, black = room.white.astype(np.float32), room.black.astype(np.float32)
    return blur_of_stripes(frames, white, black, room.noise_limit)


def main(arguments: list[str]) -> int:
    """Print a row for each blur, code and width."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--blur", type=float, nargs="+", default=[0.6, 1, 2, 3, 4.5, 6])
    parser.add_argument("--codes", nargs="+", default=["long-run", "gray", "xor-04", "three-frequency", "micro-phase"])
    parser.add_argument("--times", type=int, nargs="+", default=[1, 2, 3, 4])
    parser.add_argument("--reflectance", type=float, default=0.5)
    chosen = parser.parse_args(arguments)
    cv2.setNumThreads(1)
    for blur_px in chosen.blur:
        room = room_behind(blur_px, chosen.reflectance)
        blur = measured(room)
        print(f"\nblur {blur_px:g} px, measured {blur.sigma_px:.2f} px with the camera's")
        print("code             times  valid  error px  wrong   chosen")
        for name in chosen.codes:
            wanted = times_as_wide(CODES[name], blur.sigma_px)
            for times in sorted({*chosen.times, wanted}):
                code = widened(CODES[name], times)
                judged = room.judge(room.decode(code, room.photographs(code.patterns(PROJECTOR))))
                row = f"{name:16} {times:5d} {100 * judged.valid_share:5.1f}% {judged.median_px:9.3f}"
                print(f"{row} {100 * judged.wrong_share:5.2f}%{'   *' * (times == wanted)}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
