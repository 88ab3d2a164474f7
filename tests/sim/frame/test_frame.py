"""Frames for live compensation: the native kernel against its definition, and both against light transport itself."""

import dataclasses

import numpy as np
import pytest
from scipy.sparse import csr_array

from sim.compensation import compensate
from sim.frame.codes import fractional_code
from sim.frame.compensator import FrameCompensator, frame_model
from sim.frame.packed import packed
from sim.frame.tables import response_cubics
from sim.geometry.optics import Pose
from sim.light.transport import LightTransport
from sim.reference.frame import reference_frame
from tests.sim.frame.transports import (
    GAMMA,
    S_CURVE,
    check_same_bytes,
    difference,
    in_colour,
    level,
    picture,
    transport,
)


@pytest.mark.parametrize("shape", [(29, 45), (17, 33), (1, 100), (40, 16), (23, 7), (9, 530)])
@pytest.mark.parametrize("dither_seed", [None, 5])
def test_the_kernel_is_within_one_code_of_its_definition(shape, dither_seed):
    colour = in_colour(shape[1], shape[0])
    black = 0.01 * colour.forward(np.ones((shape[0] * shape[1], 3)))
    model = frame_model(
        colour, shape, target_scale=level(colour), black=black, eotf=GAMMA, response=GAMMA, dither_seed=dither_seed
    )
    codes = picture(shape)
    shown = FrameCompensator(model).frame(codes)
    assert difference(shown, reference_frame(model, codes)).max() <= 1
    assert (difference(shown, reference_frame(model, codes)) > 0).mean() < 0.02
    assert shown.std() > 10


@pytest.mark.parametrize("strategy", ["exact", "bounded"])
def test_threads_and_instruction_sets_change_no_byte(strategy):
    shape = (61, 83)
    colour = in_colour(shape[1], shape[0])
    model = frame_model(colour, shape, target_scale=level(colour), response=GAMMA)
    check_same_bytes(model, strategy, picture(shape), threads=(2, 3, 7))


def test_a_smooth_response_is_followed_by_cubics_and_an_uneven_one_by_a_table():
    shape = (29, 45)
    colour, codes = in_colour(shape[1], shape[0]), picture(shape)
    for response, layers in ((GAMMA, 1), (S_CURVE, 0), (np.stack([GAMMA, S_CURVE, GAMMA]), 0)):
        model = frame_model(colour, shape, target_scale=level(colour), response=response, dither_seed=3)
        assert len(response_cubics(model)) == layers
        shown = FrameCompensator(model).frame(codes)
        assert difference(shown, reference_frame(model, codes)).max() <= 1
        assert (difference(shown, reference_frame(model, codes)) > 0).mean() < 0.02
        assert shown.std() > 10


@pytest.mark.parametrize("gain", [1e6, 1e30])
def test_cubics_never_reach_beyond_the_highest_code(gain):
    model = frame_model(transport(), (29, 45), response=GAMMA, dither_seed=3)
    bright = np.full((29, 45, 3), 255, dtype=np.uint8)
    assert FrameCompensator(model).frame(bright, gain=gain).min() == 255
    assert not FrameCompensator(model).frame(np.zeros_like(bright)).any()


@pytest.mark.parametrize("unit", [1e-9, 1e9])
@pytest.mark.parametrize("strategy", ["exact", "bounded"])
def test_codes_do_not_depend_on_the_unit_of_camera_values(unit, strategy):
    one, codes = transport(), picture((29, 45))
    other = LightTransport(
        one.direct_matrix * unit, one.emission, one.radiosity, one.view * unit, pixel_patch=one.pixel_patch
    )
    shown = [
        FrameCompensator(frame_model(each, (29, 45), target_scale=level(each), response=GAMMA), strategy).frame(codes)
        for each in (one, other)
    ]
    assert difference(*shown).max() <= 1
    assert (difference(*shown) > 0).mean() < 0.01


def test_a_single_wall_is_divided_by_its_own_brightness():
    wall = transport(faces=("x1",), pose=Pose.look_at((2.4, 2.4, 1.2), (4.8, 2.4, 1.2)))
    lit = wall.direct_matrix.diagonal() > 0
    chosen = LightTransport(
        csr_array(wall.direct_matrix[lit][:, lit]),
        csr_array(wall.emission[:, lit]),
        wall.radiosity,
        csr_array(wall.view[lit]),
        pixel_patch=wall.pixel_patch[lit],
    )
    scale = 0.5 * chosen.direct_matrix.diagonal().min()
    model = frame_model(chosen, (29, 45), lit.reshape(29, 45), target_scale=scale)
    codes = picture((29, 45))
    wanted = codes.reshape(-1, 3)[lit] * scale / chosen.direct_matrix.diagonal()[:, None]
    shown = FrameCompensator(model).frame(codes).reshape(-1, 3)
    assert np.abs(shown[lit] - wanted).max() <= 0.52
    assert not shown[~lit].any()


def test_what_the_projector_can_show_is_seen_as_wanted():
    shape = (87, 135)
    colour = in_colour(shape[1], shape[0])
    light = 0.35 + 0.1 * picture(shape).reshape(-1, 3) / 255
    wanted = colour.forward(light)
    scale = wanted.max(axis=0)
    codes = np.rint(255 * wanted / scale).astype(np.uint8).reshape(*shape, 3)
    model = frame_model(colour, shape, target_scale=scale, dither_seed=1)
    compensator = FrameCompensator(model)
    seen = colour.forward(compensator.frame(codes).reshape(-1, 3) / 255) / scale
    assert compensator.last.clipped_share == 0
    assert 255 * np.sqrt(np.mean((seen - codes.reshape(-1, 3) / 255) ** 2)) < 0.8


def test_exact_frames_are_those_of_the_exact_strategy():
    shape = (116, 180)
    colour = in_colour(shape[1], shape[0])
    scale = level(colour)
    codes = picture(shape)
    black = 0.02 * colour.forward(np.ones((shape[0] * shape[1], 3)))
    target = codes.reshape(-1, 3) / 255 * scale
    best = compensate("exact", colour, target - black)
    model = frame_model(colour, shape, target_scale=scale, black=black, dither_seed=2)
    shown = FrameCompensator(model).frame(codes).reshape(-1, 3) / 255
    error = (colour.forward(shown) - best.predicted) / scale
    assert 255 * np.sqrt(np.mean(error**2)) < 0.7


def test_a_bounded_pan_stays_near_the_certified_optimum_of_each_frame():
    shape = (48, 75)
    grey = transport(shape[1], shape[0], reflectance=0.85)
    scale = level(grey)
    wide = picture((48, 120), seed=3)
    exact, bounded = (
        FrameCompensator(frame_model(grey, shape, target_scale=scale), name) for name in ("exact", "bounded")
    )
    ratios = []
    for shift in range(10):
        frame = np.ascontiguousarray(wide[:, shift : shift + 75])
        wanted = frame.reshape(-1, 3) / 255 * scale
        best = [compensate("bounded", grey, wanted[:, band], tolerance=1e-4).residual_rms for band in range(3)]
        optimum = np.sqrt(np.mean(np.square(best)))
        rms = [
            np.sqrt(np.mean((grey @ (each.frame(frame).reshape(-1, 3) / 255) - wanted) ** 2))
            for each in (bounded, exact)
        ]
        ratios.append(np.array(rms) / optimum)
    worst_bounded, worst_exact = np.max(ratios, axis=0)
    assert worst_bounded < 1.05
    assert worst_exact > 1.1
    assert bounded.last.error == pytest.approx(ratios[-1][0] * optimum / scale, rel=0.05)


def test_bounded_holds_mixing_channels_within_their_range_together():
    shape = (29, 45)
    strong = np.array([[1.0, 0.35, 0.1], [0.3, 1.0, 0.3], [0.05, 0.25, 1.0]])
    colour = in_colour(mixing=strong)
    scale = np.full(3, level(colour).mean())
    codes = picture(shape)
    wanted = codes.reshape(-1, 3) / 255 * scale
    best = compensate("bounded", colour, wanted, tolerance=1e-4)
    bounded = FrameCompensator(frame_model(colour, shape, target_scale=scale), "bounded")
    for _ in range(5):
        shown = bounded.frame(codes)
    seen = colour.forward(shown.reshape(-1, 3) / 255)
    assert np.sqrt(np.mean((seen - wanted) ** 2)) < 1.02 * best.residual_rms
    exact = FrameCompensator(frame_model(colour, shape, target_scale=scale)).frame(codes)
    assert np.sqrt(np.mean((colour.forward(exact.reshape(-1, 3) / 255) - wanted) ** 2)) > 1.05 * best.residual_rms


@pytest.mark.parametrize("strategy", ["exact", "bounded"])
def test_a_black_target_is_black(strategy):
    colour = in_colour()
    black = 0.05 * level(colour) * np.random.default_rng(0).uniform(0, 1, (29 * 45, 1)) ** 4
    model = frame_model(colour, (29, 45), target_scale=level(colour), black=black, response=GAMMA, dither_seed=4)
    compensator = FrameCompensator(model, strategy)
    for _ in range(3):
        assert not compensator.frame(np.zeros((29, 45, 3), dtype=np.uint8)).any()


@pytest.mark.parametrize("strategy", ["exact", "bounded"])
def test_a_target_beyond_the_range_is_clamped_and_counted(strategy):
    wall = transport(faces=("x1", "y1"), reflectance=0.2)
    active = wall.direct_matrix.diagonal() > 0
    model = frame_model(wall, (29, 45), target_scale=50 * (wall @ np.ones(wall.shape[1])).max())
    compensator = FrameCompensator(model, strategy)
    shown = compensator.frame(np.full((29, 45, 3), 255, dtype=np.uint8)).reshape(-1, 3)
    assert (shown[active] == 255).all()
    assert not shown[~active].any()
    assert compensator.last.clipped_share == 1
    compensator.frame(np.full((29, 45, 3), 255, dtype=np.uint8), gain=0.0)
    assert compensator.last.clipped_share == 0


def test_gain_dims_the_target():
    colour = in_colour()
    codes = picture((29, 45))
    dim = dataclasses.replace(frame_model(colour, (29, 45), target_scale=0.5 * level(colour)))
    full = frame_model(colour, (29, 45), target_scale=level(colour))
    assert np.array_equal(FrameCompensator(full).frame(codes, gain=0.5), FrameCompensator(dim).frame(codes))


def test_dither_keeps_means_that_rounding_loses():
    wall = transport(64, 64, faces=("x1",), pose=Pose.look_at((2.4, 2.4, 1.2), (4.8, 2.4, 1.2)))
    lit = wall.direct_matrix.diagonal() > 0
    asked = 100.3 / 255
    errors = []
    for seed in (None, 8):
        model = frame_model(
            wall, (64, 64), target_scale=asked * np.median(wall.direct_matrix.diagonal()[lit]), dither_seed=seed
        )
        even = dataclasses.replace(
            model, inverse_direct=packed(np.where(lit.reshape(1, 64, 64), asked / model.target_scale[0], 0.0))
        )
        shown = FrameCompensator(even).frame(np.full((64, 64, 3), 255, dtype=np.uint8)).reshape(-1, 3)[lit]
        errors.append(abs(shown.mean() - 255 * asked))
    assert errors[0] > 0.25
    assert errors[1] < 0.05


def test_sums_from_some_rows_change_hardly_anything():
    shape = (216, 384)
    grey = transport(shape[1], shape[0], patch_size_m=1.2)
    model = frame_model(grey, shape, target_scale=level(grey))
    assert len(model.sum_rows) < 0.6 * shape[0]
    whole = dataclasses.replace(model, sum_rows=np.arange(216, dtype=np.int32), row_scale=np.ones(model.n_lit))
    stripes = picture(shape)
    stripes[::2] = 0
    for codes, most in ((picture(shape), 0.5), (stripes, 3.0)):
        some, every = (FrameCompensator(each).frame(codes) for each in (model, whole))
        assert np.sqrt(np.mean(difference(some, every) ** 2.0)) < most
    assert difference(FrameCompensator(model).frame(stripes), reference_frame(model, stripes)).max() <= 1


def test_a_cut_begins_anew_as_the_first_frame_does():
    colour = in_colour()
    model = frame_model(colour, (29, 45), target_scale=level(colour))
    used = FrameCompensator(model, "bounded")
    used.frame(255 - picture((29, 45)))
    assert np.array_equal(used.frame(picture((29, 45))), FrameCompensator(model, "bounded").frame(picture((29, 45))))
    assert not used.frame(picture((29, 45)), gain=0.0).any()


def test_reset_forgets_the_frame_before():
    colour = in_colour()
    model = frame_model(colour, (29, 45), target_scale=level(colour))
    fresh = FrameCompensator(model, "bounded").frame(picture((29, 45)))
    used = FrameCompensator(model, "bounded")
    used.frame(np.maximum(picture((29, 45)), 20))
    began = used.last.passes
    used.frame(np.maximum(picture((29, 45)), 10))
    assert used.last.passes < began
    used.reset()
    assert np.array_equal(used.frame(picture((29, 45))), fresh)


def test_the_given_array_is_filled():
    grey = transport()
    compensator = FrameCompensator(frame_model(grey, (29, 45), target_scale=level(grey)))
    out = np.empty((29, 45, 3), dtype=np.uint8)
    assert compensator.frame(picture((29, 45)), out) is out
    assert np.array_equal(out, compensator.frame(picture((29, 45))))


def test_a_response_with_a_flat_start_has_an_inverse():
    flat = np.concatenate([np.zeros(20), np.linspace(0, 1, 236)])
    assert fractional_code(flat, np.array([0.0, 1.0])) == pytest.approx([0, 255])
    assert fractional_code(flat, flat[21:]) == pytest.approx(np.arange(21, 256), abs=1e-9)
    grey = transport()
    model = frame_model(grey, (29, 45), target_scale=level(grey), response=flat)
    codes = picture((29, 45))
    assert difference(FrameCompensator(model).frame(codes), reference_frame(model, codes)).max() <= 1


def test_a_picture_that_moves_fast_is_no_cut():
    colour = in_colour(160, 90)
    model = frame_model(colour, (90, 160), target_scale=level(colour))
    wide = picture((90, 400))
    compensator = FrameCompensator(model, "bounded")
    passes = []
    for first in (0, 8, 16, 24):
        compensator.frame(np.ascontiguousarray(wide[:, first : first + 160]))
        passes.append(compensator.last.passes)
    assert passes == [6, 2, 2, 2]
