"""``rig bench decode``: codes in a room that nobody tuned to, and criteria that catch what they are there for."""

from dataclasses import replace

import numpy as np
import pytest

from calibration import CODES
from calibration.structured_light.decode import decode_gray
from rig.benchmark.benches.decode import accuracy, agreement
from rig.benchmark.records import Point
from rig.benchmark.references.coded_room import SATURATION_DN, CodedRoom, room_settings
from rig.devices.simulated.world import SimulatedWorld

BRIGHT = 0.8


@pytest.fixture(scope="module")
def room():
    settings = room_settings(BRIGHT, 160, 192).model_copy(update={"cell_size_m": 0.4})
    return CodedRoom(SimulatedWorld(settings, (120, 160), (144, 192)))


@pytest.fixture(scope="module")
def found(room):
    names = ("gray", "long-run", "three-frequency", "micro-phase")
    frames = {name: room.photographs(CODES[name].patterns(room.projector_shape)) for name in names}
    return frames, {name: room.decode(CODES[name], frames[name]) for name in names}


def test_no_code_is_misread_in_a_room_that_reflects_four_fifths(room, found):
    frames, read = found
    readings = {name: room.judge(each) for name, each in read.items()}
    assert {name: reading.wrong_share for name, reading in readings.items() if reading.wrong_share > 0.004} == {}
    trusting = decode_gray(
        frames["gray"],
        room.projector_shape,
        white=room.white,
        black=room.black,
        contrast_limit=room.noise_limit,
        bit_limit=room.noise_limit,
        saturation=SATURATION_DN,
    )
    assert room.judge(trusting).wrong_share > 0.01


@pytest.mark.parametrize("name", ["long-run", "three-frequency", "micro-phase"])
def test_codes_without_wide_stripes_are_read_nearly_everywhere_and_know_how_well(room, found, name):
    reading = room.judge(found[1][name])
    assert reading.valid_share > 0.8
    assert reading.median_px < 0.15
    assert 0.5 < reading.sigmas < 2


def test_two_codes_of_one_scene_agree(found):
    assert agreement(found[1]) <= 0.3


def test_gray_code_is_read_at_more_pixels_with_fewer_lights_on(room, found):
    first = found[1]["gray"]
    again, pictures = room.filled_in(CODES["gray"], first, 4)
    assert pictures > 4 * len(CODES["gray"].pattern_names(room.projector_shape))
    before, after = room.judge(first), room.judge(again)
    assert after.valid_share > before.valid_share + 0.1
    assert after.wrong_share < 0.004


def points():
    detail = {"wrong": 0.0001, "sigmas": 1.1, "valid": 0.95}
    point = Point(problem="a", method="long-run", n=42, error=0.03, detail=detail)
    return [replace(point, method=name) for name in ("long-run", "three-frequency", "micro-phase", "gray")]


@pytest.mark.parametrize(
    ("changes", "missed"),
    [
        ({"wrong": 0.01}, "wrong though called valid"),
        ({"sigmas": 0.3}, "errors over their sigmas"),
        ({"sigmas": 3.0}, "errors over their sigmas"),
        ({"valid": 0.5}, "valid of the robust codes"),
    ],
)
def test_what_is_planted_is_found(changes, missed):
    planted = points()
    planted[1] = replace(planted[1], detail={**planted[1].detail, **changes})
    (found,) = [criterion.what for criterion in accuracy("a", planted, 0.1) if not criterion.met]
    assert missed in found
    assert all(criterion.met for criterion in accuracy("a", points(), 0.1))


def test_codes_that_disagree_are_found():
    assert [c.what for c in accuracy("a", points(), 0.5) if not c.met] == ["a: two codes apart, median, at most"]
    assert np.isfinite(accuracy("a", points(), 0.5)[1].value)
