"""Patches that the projector's picture covers in part: what the camera sees of the rest counts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration.light import faces as walls
from calibration.light.reflectance import ReflectanceFit
from rig.stages.light.whole_patches import SeenPatches, WholePatches, whole_patches, with_unseen_parts
from rig.stages.scene_model import PosedLens, cast_pixels
from sim.geometry.optics import Lens, Pose
from sim.scenes.gridded import room

LIT, REST, FLUX, ARRIVING = 0.2, 0.8, 2.0, 0.5


@pytest.fixture(scope="module")
def seen() -> SeenPatches:
    """A wall of one paint left of the picture's middle, of another right of it; only the left half is lit."""
    scene = room((2.0, 2.0, 2.0), 1.0, 0.5, ("x1",))
    lens = Lens(
        width_px=256, height_px=256, focal_px=(160.0, 160.0), principal_point_px=(127.5, 127.5), distortion=(0.0,) * 5
    )
    # It looks along x from the middle of the room, its right is -y.
    turn = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
    camera = PosedLens(lens, Pose(turn, -turn @ np.array([0.2, 0.6, 1.0])))
    hits = cast_pixels(scene, camera)
    on_wall, y = hits.hits.patch >= 0, np.nan_to_num(hits.points_m[:, 1])
    lit = on_wall & (y > 0.5)
    rho = np.where(lit, LIT, REST)
    e = np.where(lit, 1.0, 0.0)
    return SeenPatches(
        scene=scene,
        camera=camera,
        hits=hits,
        told=lit & (y > 0.55),
        direct=rho * FLUX * e,
        share=FLUX * e / (FLUX * e + ARRIVING),
        white=rho * (FLUX * e + ARRIVING),
        irradiance=e,
    )


def fit_of(n_patches: int) -> ReflectanceFit:
    """Reflectances of which only the flux counts here."""
    return ReflectanceFit(
        reflectance=np.full(n_patches, LIT),
        source=np.zeros(n_patches, dtype=np.uint8),
        flux=FLUX,
        sigma=np.zeros(n_patches),
        unseen_reflectance=0.5,
        global_rms=0.0,
        flux_sigma=0.0,
        unseen_sigma=0.0,
    )


def completed(seen: SeenPatches) -> WholePatches:
    """Of all patches of the wall, as if all were told to be like the lit part."""
    n = seen.scene.n_patches
    return whole_patches(seen, np.full(n, LIT * FLUX), fit_of(n), np.full(n, ARRIVING))


def test_a_patch_lit_in_half_reflects_what_both_halves_do(seen: SeenPatches) -> None:
    found = completed(seen)
    half = [k for k in range(seen.scene.n_patches) if seen.scene.vertices[k, :, 1].mean() < 1]
    assert found.whole[half] / FLUX == pytest.approx((LIT + REST) / 2, abs=0.06)
    assert found.lit_part[half] * found.whole[half] == pytest.approx(LIT * FLUX)


def test_a_patch_that_is_all_lit_stays_as_it_is(seen: SeenPatches) -> None:
    whole = [k for k in range(seen.scene.n_patches) if seen.scene.vertices[k, :, 1].mean() > 1]
    assert completed(seen).whole[whole] == pytest.approx(LIT * FLUX)


def test_a_shadow_is_not_taken_for_dark_paint(seen: SeenPatches) -> None:
    # The projector would reach the rest of the patch, were nothing in its way.
    everywhere = np.where(seen.hits.hits.patch >= 0, 1.0, 0.0)
    found = completed(replace(seen, irradiance=everywhere))
    assert found.whole == pytest.approx(LIT * FLUX)


def test_what_nobody_saw_of_a_patch_makes_its_reflectance_less_certain(seen: SeenPatches) -> None:
    n = seen.scene.n_patches
    share = np.zeros(n)
    share[0] = 0.5
    half_seen = WholePatches(whole=np.full(n, LIT * FLUX), lit_part=np.ones(n), unseen_share=share)
    sigma = with_unseen_parts(fit_of(n), half_seen, seen.scene.region).sigma
    assert sigma[0] == pytest.approx(0.015)
    assert sigma[1:] == pytest.approx(0)


def test_pixels_beside_what_is_not_whole_are_beside_an_edge() -> None:
    face = np.zeros((20, 20), dtype=np.intp)
    face[:, 10:] = 1
    whole = np.ones((20, 20), dtype=bool)
    whole[:2] = False
    beside = walls.beside_edges(face, whole)
    assert beside[:5].all()
    assert beside[:, 7:13].all()
    assert not beside[5:, :7].any()
