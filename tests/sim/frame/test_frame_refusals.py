"""What frames, gains, transports and models are refused, and how it is said."""

import numpy as np
import pytest

from sim.errors import SimulationError
from sim.frame.compensator import FrameCompensator, frame_model
from sim.light.colour import ColourTransport
from tests.sim.frame.transports import GAMMA, transport

FRAME = np.zeros((29, 45, 3), dtype=np.uint8)


@pytest.mark.parametrize(
    ("frame", "said"),
    [
        (FRAME.astype(np.float32), "float32 instead of uint8"),
        (FRAME.tolist(), "list instead of uint8"),
        (FRAME[:, :44].copy(), r"\(29, 44, 3\)"),
        (FRAME[..., 0], r"\(29, 45\)"),
        (FRAME[:, ::-1], "strides"),
    ],
)
def test_a_frame_that_cannot_be_read_is_named(frame, said):
    compensator = FrameCompensator(frame_model(transport(), (29, 45)))
    with pytest.raises(SimulationError, match=said):
        compensator.frame(frame)
    with pytest.raises(SimulationError, match=f"out.*{said}"):
        compensator.frame(FRAME, out=frame)


@pytest.mark.parametrize("gain", [-1.0, np.nan, np.inf])
def test_a_gain_that_is_none_is_refused(gain):
    with pytest.raises(SimulationError, match="gain"):
        FrameCompensator(frame_model(transport(), (29, 45))).frame(FRAME, gain=gain)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"shape": (29, 44)}, "1276"),
        ({"active": np.zeros((29, 45), dtype=bool)}, "0 of 1305"),
        ({"black": -1.0}, "0 or more"),
        ({"black": np.zeros(7)}, r"black of shape \(7,\)"),
        ({"response": GAMMA[::-1]}, "response must"),
        ({"response": 0.1 + GAMMA}, "begins at 0.1"),
        ({"eotf": GAMMA[:5]}, r"eotf of shape \(5,\)"),
        ({"eotf": np.full(256, np.nan)}, "eotf must"),
        ({"target_scale": 0.0}, "target scale"),
    ],
)
def test_what_does_not_fit_a_model_is_named(options, said):
    with pytest.raises(SimulationError, match=said):
        frame_model(transport(), **{"shape": (29, 45), **options})


def test_unknown_strategies_and_no_threads_are_refused():
    model = frame_model(transport(), (29, 45))
    with pytest.raises(SimulationError, match="there are exact, bounded"):
        FrameCompensator(model, "paper")
    with pytest.raises(SimulationError, match="0 threads"):
        FrameCompensator(model, threads=0)


def test_two_bands_are_no_colour_frame():
    bands = [transport(), transport()]
    with pytest.raises(SimulationError, match="2 bands"):
        frame_model(ColourTransport(bands, np.eye(2)), (29, 45))
