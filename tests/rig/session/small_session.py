"""A session of two steps and five frames, whose frames are a function of time alone."""

import numpy as np

from rig.devices.clock import VirtualClock
from rig.devices.protocols import RawFrame
from rig.session import Session, Step

SHAPE = (6, 8, 1)


def frame_at(time_s: float) -> RawFrame:
    """What a camera sees is a function of time alone, as on the simulated world."""
    random = np.random.default_rng(round(time_s * 1e6))
    pixels = random.integers(0, 4096, SHAPE, dtype=np.uint16)
    return RawFrame(pixels=pixels, exposure_s=0.01 / 3, started_s=time_s, sequence=round(time_s * 10))


def shoot_missing(step: Step, names: list[str], clock: VirtualClock) -> None:
    for name in names:
        if not step.has_frame(name):
            frame = frame_at(clock.now_s() + 0.1)
            clock.wait_until_s(frame.started_s + frame.exposure_s)
            step.save_frame(name, frame)


def workflow(session: Session) -> None:
    """Two steps of frames and results; everything that is used later is read back from the disk."""
    clock = VirtualClock(session.last_clock_s)
    black = session.step("black", settings={"count": 2})
    if not black.done:
        shoot_missing(black, ["black-0", "black-1"], clock)
        mean = np.mean([black.load_frame(n).pixels for n in black.frame_names], axis=0)
        black.save_image("black", {"Y": mean[..., 0]})
        black.finish()
    gray = session.step("gray", settings={"bits": [0, 1, 2]}, needs=["black"])
    if not gray.done:
        shoot_missing(gray, ["gray-column-00", "gray-column-01", "gray-column-02"], clock)
        level = session.finished("black").load_image("black")["Y"]
        total = sum(gray.load_frame(n).pixels[..., 0].astype(np.float64) - level for n in gray.frame_names)
        gray.save_image("map", {"sum": np.asarray(total)}, folder="maps")
        gray.save_record("fit", {"third": float(np.mean(total)) / 3, "matrix": np.eye(2)})
        gray.finish()
    session.write_metrics({"third": session.finished("gray").load_record("fit", dict)["third"]})
