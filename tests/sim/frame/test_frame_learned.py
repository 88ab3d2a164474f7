"""Frames of a transport of which photographs have taught something."""

import numpy as np
import pytest

from sim.compensation import compensate
from sim.frame.compensator import FrameCompensator, frame_model
from sim.light.learned_transport import with_learned
from sim.reference.frame import reference_frame
from tests.sim.frame.transports import difference, level, picture, transport

SHAPE = (87, 135)


@pytest.fixture(scope="module")
def plain():
    return transport(SHAPE[1], SHAPE[0])


def learned(plain, by_pixel):
    """With two changes of its light that are about a fifth of it."""
    random = np.random.default_rng(4)
    n_patches = plain.radiosity.n_patches
    changes = random.normal(size=(by_pixel.shape[1], n_patches)) * (np.arange(n_patches) % 3 > 0)
    before, change = (
        plain.global_ @ np.ones(plain.shape[1]),
        by_pixel @ (changes @ (plain.emission @ np.ones(plain.shape[1]))),
    )
    return with_learned(plain, by_pixel * 0.2 * before.max() / np.abs(change).max(), changes)


@pytest.fixture(scope="module")
def seen_by_patches(plain):
    """What was learned is as smooth as what patches show."""
    return learned(plain, plain.view @ np.random.default_rng(5).uniform(size=(plain.radiosity.n_patches, 2)))


def shown_and_wanted(plain, each):
    """Codes of a frame, and those of exact compensation with all that was learned."""
    codes, scale = picture(SHAPE), level(plain)
    wanted = compensate("exact", each, codes[..., 0].ravel() / 255 * scale).projector_image
    model = frame_model(each, SHAPE, target_scale=scale)
    frame = FrameCompensator(model).frame(codes)
    assert difference(frame, reference_frame(model, codes)).max() <= 1
    return frame[..., 0].ravel().astype(float), np.clip(255 * wanted, 0, 255)


def rms(difference):
    return float(np.sqrt(np.mean(difference**2)))


def test_frames_are_what_exact_compensation_is_with_all_that_was_learned(plain, seen_by_patches):
    frame, wanted = shown_and_wanted(plain, seen_by_patches)
    without, wanted_without = shown_and_wanted(plain, plain)
    assert rms(frame - wanted) < 1.5 * rms(without - wanted_without)
    assert rms(frame - wanted) < 0.3 * rms(without - wanted)
    assert frame_model(seen_by_patches, SHAPE).learned_left_out < 0.05


def test_what_changes_within_patches_is_said_to_be_left_out(plain):
    fine = np.random.default_rng(6).normal(size=(plain.shape[0], 2))
    assert frame_model(learned(plain, fine), SHAPE).learned_left_out > 0.9
    assert frame_model(plain, SHAPE).learned_left_out == 0
