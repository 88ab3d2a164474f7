"""Light of a plan in lux and cd/m², beside what a hand can calculate."""

import pickle

import numpy as np
import pytest

from rig.plan.compute import plan_room
from rig.plan.light import lit_room
from rig.plan.request import request_of
from tests.rig.plan.rooms import projector, room

AREA_M2 = 2 * (4.8 * 4.8 + 2 * 4.8 * 2.4)
FACING = projector(throw_ratio=1.5, position_m=[1.8, 2.4, 1.2], look_at_m=[4.8, 2.4, 1.2])
"""3 m before a wall, square to it: a picture of 2 m x 1.5 m."""
BLACK_WALLS = {"all": 0.001, "x1": 0.5}


@pytest.mark.parametrize("rho", [0.2, 0.7, 0.9])
def test_lamps_that_light_a_closed_room_evenly_give_the_light_of_an_integrating_cavity(rho: float) -> None:
    request = room(paint={"all": rho}, room_light={"lamp_lm": 1000})
    by_hand_lux = 1000 / AREA_M2 + rho / (1 - rho) * 1000 / AREA_M2
    for surface in plan_room(request).surfaces:
        assert surface.ambient_lux == pytest.approx(by_hand_lux, rel=0.02)


@pytest.mark.parametrize("rho", [0.2, 0.7, 0.9])
def test_a_projectors_indirect_light_is_on_average_that_of_an_integrating_cavity(rho: float) -> None:
    result = plan_room(room(paint={"all": rho}))
    assert result.totals.indirect_lux == pytest.approx(rho / (1 - rho) * 3000 / AREA_M2, rel=0.02)


def test_all_lumens_land_on_the_walls_of_a_closed_room() -> None:
    surfaces = plan_room(room()).surfaces
    assert sum(one.direct_lux * one.area_m2 for one in surfaces) == pytest.approx(3000, rel=1e-3)


def test_a_wall_among_black_ones_has_lumens_over_area_times_reflectance_over_pi() -> None:
    result = plan_room(room(paint=BLACK_WALLS, projector=FACING))
    wall = next(one for one in result.surfaces if one.name == "x1")
    assert result.totals.lit_m2 == pytest.approx(2.0 * 1.5, rel=1e-3)
    assert wall.white_cdm2 == pytest.approx(0.5 / np.pi * 3000 / 3.0, rel=2e-3)
    assert wall.coverage == pytest.approx(3.0 / wall.area_m2, rel=1e-3)
    assert wall.px_per_m == pytest.approx(1600 / 2.0, rel=5e-3)
    assert wall.contrast == pytest.approx(1000, rel=1e-6)


def test_light_of_the_room_that_was_measured_is_there_whatever_the_paint() -> None:
    for rho in (0.3, 0.8):
        result = plan_room(room(paint={"all": rho}, room_light={"lux": 5}))
        assert all(one.ambient_lux == pytest.approx(5) for one in result.surfaces)
        assert all(one.black_cdm2 >= rho * 5 / np.pi for one in result.surfaces)
        assert result.contrast.full_in_room < 1000


def test_a_window_has_the_luminance_that_it_is_said_to_have_and_lights_the_room() -> None:
    opening = {"name": "window", "surface": "x0", "from_m": [1, 1], "to_m": [2, 2], "emits_cdm2": 100}
    dark, lit = room(projector=FACING), room(projector=FACING, opening=[opening])
    without, result = plan_room(dark), plan_room(lit)
    window = next(one for one in result.surfaces if one.name == "window")
    assert window.area_m2 == pytest.approx(1.0)
    assert window.white_cdm2 > 100
    assert window.paint.name == "window-glass"
    assert all(one.ambient_lux > 1 for one in result.surfaces if one.name != "window")
    assert result.totals.white_cdm2 > without.totals.white_cdm2
    # All that the window sends, pi L A, is absorbed somewhere.
    absorbed = sum(one.ambient_lux * one.area_m2 * (1 - one.paint.reflectance) for one in result.surfaces)
    assert absorbed == pytest.approx(np.pi * 100 * 1.0, rel=1e-3)


def test_what_is_wanted_does_not_follow_the_paint() -> None:
    bright, dark = (plan_room(room(paint={"all": rho}, show=DIM)).pictures[0] for rho in (0.8, 0.4))
    assert bright.wanted_mean_cdm2 == dark.wanted_mean_cdm2 == pytest.approx(8 * 70 / 255)
    # Both can be shown; on a scale that followed the room the darker one would look worse.
    assert bright.outcome("bounded").error < 0.5
    assert dark.outcome("bounded").error < 0.5


def test_brightness_that_no_projector_of_this_room_has_is_told_with_its_place() -> None:
    result = plan_room(room(paint=BLACK_WALLS, projector=FACING, show={"white_cdm2": 500, "pictures": ["white"]}))
    (part,) = result.pictures[0].unreached
    assert part.surface == "x1"
    assert part.too_dark_m2 == pytest.approx(3.0, rel=0.01)
    assert part.too_bright_m2 == 0
    assert result.totals.reached_share == 0
    assert "lumens" in result.remarks[0]


def test_a_lens_shift_of_half_a_picture_puts_its_lower_edge_on_the_axis() -> None:
    low = {"position_m": [1.8, 2.4, 0.5], "look_at_m": [4.8, 2.4, 0.5]}
    lit = lit_room(room(projector={**FACING, **low, "lens_shift": [0.0, 0.5]}))
    heights = lit.views[0].pose.position_m[2] + lit.hits.distance * lit.views[0].rays[:, 2]
    pitch = 2.0 / 64
    assert heights.min() == pytest.approx(0.5 + pitch / 2)
    assert heights.max() == pytest.approx(0.5 + 1.5 - pitch / 2)


def test_a_person_halfway_to_the_wall_throws_a_shadow_of_twice_the_width() -> None:
    person = {"name": "guest", "at_m": [3.3, 2.4], "height_m": 1.2, "radius_m": 0.25}
    result = plan_room(room(paint=BLACK_WALLS, projector=FACING, person=[person], show={**SHARP}))
    (shadow,) = result.shadows
    # From the axis down: the person ends at its height. Tangents of the cylinder: tan = r / sqrt(d² - r²).
    width_m = 2 * 3.0 * 0.25 / np.sqrt(1.5**2 - 0.25**2)
    assert shadow.by_surface_m2 == {"x1": pytest.approx(width_m * 0.75, rel=0.03)}
    assert shadow.picture_share == pytest.approx(width_m * 0.75 / 3.0, rel=0.03)
    assert shadow.dazzled


DIM = {"white_cdm2": 8, "pictures": ["grey"], "strategies": [], "width_px": 64}
SHARP = {"white_cdm2": 20, "pictures": ["grey"], "strategies": [], "width_px": 240}


def test_a_viewer_beside_the_projector_sees_its_pixels_under_its_own_angle() -> None:
    far = projector(throw_ratio=5.0, position_m=[0.4, 2.4, 1.2], look_at_m=[4.8, 2.4, 1.2])
    viewer = {"name": "guest", "eye_m": [0.4, 2.4, 1.2]}
    (sight,) = plan_room(room(projector=far, viewer=[viewer])).viewers
    assert sight.px_per_deg == pytest.approx(1600 / np.degrees(2 * np.arctan(0.1)), rel=0.01)
    assert sight.visible_share == pytest.approx(1.0)


def test_a_box_hides_part_of_the_picture_from_a_viewer_behind_it() -> None:
    behind = {"name": "behind", "eye_m": [0.6, 2.4, 0.6]}
    above = {"name": "above", "eye_m": [0.6, 2.4, 2.2]}
    high = projector(throw_ratio=1.2, position_m=[1.0, 2.4, 2.2], look_at_m=[4.8, 2.4, 1.0])
    plan = plan_room(room(room={"scene": "room-with-box", "patch_m": 0.8}, projector=high, viewer=[behind, above]))
    assert plan.viewers[0].visible_share < 0.8 < plan.viewers[1].visible_share


def test_a_plan_is_a_pure_function_of_what_its_request_says_in_json() -> None:
    request = room(viewer=[{"name": "guest", "eye_m": [2, 2, 1.6], "stands": True}])
    again = request_of(pickle.loads(pickle.dumps(request)).as_json())
    assert again == request
    assert plan_room(again) == plan_room(request)


@pytest.mark.parametrize("scene", ["corner", "sloped-room", "room-with-box"])
def test_rooms_of_the_library_can_be_planned(scene: str) -> None:
    near = projector(position_m=[0.8, 0.9, 1.0], look_at_m=[0.1, 0.2, 0.9])
    result = plan_room(room(room={"scene": scene, "patch_m": 1.0}, projector=near))
    assert result.totals.white_cdm2 > 0
    assert sum(one.coverage * one.area_m2 for one in result.surfaces) == pytest.approx(result.totals.lit_m2, rel=1e-6)
