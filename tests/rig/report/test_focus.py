"""Where to focus, in words: what is said of pictures whose blur is known."""

import numpy as np
import pytest

from rig.report.focus import FocusOf, focus_figure, focus_text

SHAPE = (60, 80)
ROW, COLUMN = np.mgrid[: SHAPE[0], : SHAPE[1]] / np.array(SHAPE)[:, None, None]
"""Shares of the height and of the width."""


def device(
    sigma_px: np.ndarray, distance_m: np.ndarray | None = None, known_px: float = 0.02, role: str = "projector"
) -> FocusOf:
    return FocusOf(
        role=role,
        sigma_px=np.broadcast_to(sigma_px, SHAPE),
        known_px=known_px,
        measured=np.ones(SHAPE, bool),
        distance_m=np.full(SHAPE, 3.0) if distance_m is None else distance_m,
    )


def test_a_sharp_device_is_called_so_and_left_alone() -> None:
    said = device(np.array(0.3)).sentence
    assert said == "The projector is sharp everywhere: 0.30 px ± 0.02 px, the same all over."


def test_it_says_where_it_is_sharp_and_where_not() -> None:
    said = device(0.4 + COLUMN + 0.5 * ROW).sentence
    assert "0.40 px at the upper left" in said
    assert "px at the lower right" in said
    assert "sharp over" in said


@pytest.mark.parametrize(("near_px", "far_px", "way"), [(0.5, 1.2, "focus farther"), (1.2, 0.5, "focus nearer")])
def test_blur_that_follows_distance_tells_which_way_to_turn(near_px: float, far_px: float, way: str) -> None:
    distance_m = 2 + 2 * COLUMN
    said = device(near_px + (far_px - near_px) * COLUMN, distance_m).sentence
    assert said.endswith(f"{way}.")


@pytest.mark.parametrize(
    ("sigma_px", "distance_m", "known_px"),
    [
        (0.9 + 0.8 * np.abs(COLUMN - 0.5), 2 + 2 * COLUMN, 0.02),  # of the lens, alike near and far
        (0.5 + 0.7 * COLUMN, 3 + 0.1 * COLUMN, 0.02),  # a wall at one distance
        (0.5 + 0.7 * COLUMN, 2 + 2 * COLUMN, 0.4),  # hardly known
    ],
)
def test_where_blur_does_not_follow_distance_no_way_is_told(
    sigma_px: np.ndarray, distance_m: np.ndarray, known_px: float
) -> None:
    said = device(sigma_px, distance_m, known_px).sentence
    assert "either way" in said
    assert "focus farther" not in said
    assert "focus nearer" not in said


def test_what_was_not_measured_does_not_count() -> None:
    half = FocusOf(
        role="camera",
        sigma_px=np.where(COLUMN < 0.5, 0.3, 5.0),
        known_px=0.02,
        measured=COLUMN < 0.5,
        distance_m=np.full(SHAPE, 3.0),
    )
    assert "sharp everywhere" in half.sentence
    nothing = FocusOf(
        role="camera",
        sigma_px=np.zeros(SHAPE),
        known_px=0.02,
        measured=np.zeros(SHAPE, bool),
        distance_m=np.full(SHAPE, 3.0),
    )
    assert nothing.sentence == "Nothing of the camera's picture was measured."


def test_maps_and_words_show_both_devices() -> None:
    both = device(0.4 + COLUMN), device(np.array(0.3), role="camera")
    assert focus_figure(both).startswith("data:image/png;base64,")
    assert "The projector is" in focus_text(both)
    assert "The camera is" in focus_text(both)
