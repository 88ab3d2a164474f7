"""Walls of which nobody saw any: which they are, and how far light leaves their place open."""

from __future__ import annotations

import pytest

from rig.stages.geometry import BoxSurface
from rig.stages.light import unseen_walls
from rig.stages.light.unseen_walls import PlacedByLight, shift_of, unmeasured_axes

FACES = ("x0", "x1", "y0", "y1", "floor", "ceiling")


def surface(seen: tuple[str, ...], faces: tuple[str, ...] = FACES) -> BoxSurface:
    return BoxSurface(size_m=(4.0, 5.0, 2.5), seen=seen, faces=faces, angle_error_deg=0.0, notes="")


@pytest.mark.parametrize(
    ("seen", "height_known", "axes"),
    [
        (("x1", "y1"), False, ("z",)),
        (("x1", "y1"), True, ()),
        (("x1", "y1", "ceiling"), False, ()),
        (("x1", "floor"), False, ("y",)),
    ],
)
def test_an_axis_is_unmeasured_where_neither_of_its_walls_was_seen_or_taped(
    seen: tuple[str, ...], height_known: bool, axes: tuple[str, ...]
) -> None:
    assert unmeasured_axes(surface(seen), height_known=height_known) == axes


def test_an_open_scene_has_no_wall_that_nobody_saw() -> None:
    assert unmeasured_axes(surface(("x1", "y1"), ("x1", "y1")), height_known=False) == ()


def test_devices_move_along_the_axes_that_the_light_tells() -> None:
    told = PlacedByLight(axis="z", shift_m=0.3, projector_m=1.2, sigma_m=0.05, light_error=0.01)
    assert shift_of((told,)) == (0.0, 0.0, 0.3)
    assert shift_of(()) == (0.0, 0.0, 0.0)


def test_light_that_leaves_a_place_open_has_a_sigma_as_wide_as_what_can_be() -> None:
    flat, told = ({x / 10: cost(x / 10) for x in range(11)} for cost in (lambda _: 1.0, lambda x: 400 * (x - 0.5) ** 2))
    assert unseen_walls._spread(flat, 0.5) == pytest.approx(1 / 12**0.5, rel=0.05)
    # exp(-c/2) of a parabola 400 x² is a normal distribution of 0.05; 0.02 is the least, and the parabola is in pieces.
    assert unseen_walls._spread(told, 0.5) == pytest.approx(0.06, abs=0.015)


def test_two_places_that_explain_the_light_alike_are_both_in_the_sigma() -> None:
    two = {0.0: 9.0, 0.2: 0.0, 0.4: 9.0, 0.6: 9.0, 0.8: 0.1, 1.0: 9.0}
    assert unseen_walls._spread(two, 0.2) > 0.35
