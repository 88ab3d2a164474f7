"""The sensor's steps, one at a time."""

import numpy as np
import pytest

from sim.errors import SimulationError
from sim.picture.sensor import Sensor, expose


def test_without_noise_the_sensor_is_linear_and_clips():
    numbers = expose(np.array([0.0, 0.5, 1.0, 7.0]), 1.0, Sensor(bits=12))
    assert numbers.tolist() == [0, 2048, 4095, 4095]
    assert numbers.dtype == np.uint16


def test_black_level_lifts_darkness_and_keeps_full_scale():
    assert expose(np.array([0.0, 1.0]), 1.0, Sensor(bits=8, black_level_dn=16)).tolist() == [16, 255]


def test_shot_noise_grows_as_the_root_of_the_light_and_read_noise_does_not():
    sensor = Sensor(full_well_e=10_000, read_noise_e=20.0, bits=16, black_level_dn=2000)
    electrons_per_dn = 10_000 / (65535 - 2000)
    rng = np.random.default_rng(0)
    dark = expose(np.zeros(100_000), 1.0, sensor, rng).std() * electrons_per_dn
    bright = expose(np.full(100_000, 0.25), 1.0, sensor, rng).std() * electrons_per_dn
    assert dark == pytest.approx(20.0, rel=0.02)
    assert bright == pytest.approx(np.sqrt(2500 + 400), rel=0.02)


def test_the_same_generator_state_gives_the_same_frame():
    frames = [expose(np.full(50, 0.3), 1.0, Sensor(), np.random.default_rng(4)) for _ in range(2)]
    assert np.array_equal(*frames)


def test_impossible_sensors_and_light_are_refused():
    with pytest.raises(SimulationError, match="bits"):
        Sensor(bits=20)
    with pytest.raises(SimulationError, match="black level"):
        Sensor(bits=8, black_level_dn=300)
    with pytest.raises(SimulationError, match="exposure 0"):
        expose(np.ones(3), 0.0, Sensor())
    with pytest.raises(SimulationError, match="darkest light -1"):
        expose(np.array([-1.0]), 1.0, Sensor())
