"""Inverse radiosity and vignetting against a room of finer patches, solved here by its own quadrature."""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import pytest

from calibration.errors import CalibrationError
from calibration.light.alike import Alike
from calibration.light.faces import on_model_of
from calibration.light.reflectance import ReflectanceSource, estimate_reflectance
from calibration.light.vignetting import fit_vignetting

SIZE_M = np.array([4.8, 4.8, 2.4])
FINE_M, COARSE_M = 0.3, 0.6
FLUX = 37.0


@dataclass(frozen=True)
class Patches:
    centre: np.ndarray
    normal: np.ndarray
    face: np.ndarray
    coarse: np.ndarray


def box(cell_m, parent_m):
    """Square patches of the six faces; for each, the number of the larger square that holds it."""
    centre, normal, face, key = [], [], [], []
    for axis in range(3):
        others = [k for k in range(3) if k != axis]
        counts = [round(SIZE_M[k] / cell_m) for k in others]
        u, v = (g.ravel() for g in np.meshgrid(*(np.arange(n) for n in counts), indexing="ij"))
        for high in (0, 1):
            points = np.zeros((len(u), 3))
            points[:, others[0]], points[:, others[1]] = (u + 0.5) * cell_m, (v + 0.5) * cell_m
            points[:, axis] = SIZE_M[axis] * high
            inward = np.zeros(3)
            inward[axis] = 1 - 2 * high
            centre.append(points)
            normal.append(np.tile(inward, (len(u), 1)))
            face.append(np.full(len(u), 2 * axis + high))
            ratio = round(parent_m / cell_m)
            key.append((2 * axis + high) * 10_000 + (u // ratio) * 100 + v // ratio)
    _, parent = np.unique(np.concatenate(key), return_inverse=True)
    return Patches(np.concatenate(centre), np.concatenate(normal), np.concatenate(face), parent)


def kernel(a, b):
    """(N, M) cos cos / (π r²) between points of the room."""
    offset = b.centre[None] - a.centre[:, None]
    r2 = np.maximum((offset**2).sum(-1), 1e-9)
    cosine_a = np.maximum(np.einsum("ijk,ik->ij", offset, a.normal), 0)
    cosine_b = np.maximum(-np.einsum("ijk,jk->ij", offset, b.normal), 0)
    return cosine_a * cosine_b / (np.pi * r2**2)


@lru_cache
def form_factors():
    """Fine patches from four samples each; rows made to sum to 1 while A F stays symmetric."""
    samples = box(FINE_M / 2, FINE_M)
    between = kernel(samples, samples) * (FINE_M / 2) ** 2
    n = samples.coarse.max() + 1
    rows = np.zeros((n, len(between)))
    np.add.at(rows, samples.coarse, between / 4)
    F = np.zeros((n, n))
    np.add.at(F.T, samples.coarse, rows.T)
    for _ in range(30):
        scale = 1 / np.sqrt(F.sum(1))
        F *= scale[:, None] * scale
    return F / F.sum(1, keepdims=True)


def device(position, target, hfov_deg, aspect):
    """(visible, irradiance of unit flux, radius) at points: equal flux for every pixel of an ideal lens."""

    def look(points, normals):
        ahead = np.subtract(target, position) / np.linalg.norm(np.subtract(target, position))
        right = np.cross(ahead, [0, 0, 1.0])
        right /= np.linalg.norm(right)
        local = (points - position) @ np.stack([right, np.cross(ahead, right), ahead]).T
        depth = np.maximum(local[:, 2], 1e-6)
        xy, half = local[:, :2] / depth[:, None], np.tan(np.radians(hfov_deg) / 2)
        inside = (local[:, 2] > 0.01) & (np.abs(xy[:, 0]) < half) & (np.abs(xy[:, 1]) < half * aspect)
        distance = np.linalg.norm(local, axis=1)
        cosine = -((points - position) * normals).sum(1) / distance
        radius = np.linalg.norm(xy, axis=1) / np.hypot(half, half * aspect)
        return inside, inside * cosine / (distance**2 * (depth / distance) ** 3), radius

    return look


PROJECTOR = device((1.0, 1.0, 1.2), (4.8, 4.72, 1.2), 98, 0.75)
CAMERA = device((0.6, 1.42, 1.38), (4.6, 4.55, 1.12), 100, 0.75)


@dataclass(frozen=True, kw_only=True)
class MeasuredRoom:
    """What the fit is given, and the truth on its coarse patches."""

    direct_over_irradiance: np.ndarray
    global_light: np.ndarray
    irradiance: np.ndarray
    form_factors: np.ndarray
    reflectance: np.ndarray
    face: np.ndarray


def measured(seed, noise=0.02, dark=()):
    """The room, some of its coarse patches dark."""
    random = np.random.default_rng(seed)
    fine, F = box(FINE_M, COARSE_M), form_factors()
    rho = np.array([0.70, 0.71, 0.69, 0.68, 0.66, 0.76])[fine.face] + random.uniform(-0.05, 0.05, len(fine.face))
    rho = np.where(np.isin(fine.coarse, dark), 0.2, rho)
    _, e, _ = PROJECTOR(fine.centre, fine.normal)
    emission = rho * FLUX * e
    arriving = F @ np.linalg.solve(np.eye(len(rho)) - rho[:, None] * F, emission)
    seen, _, _ = CAMERA(fine.centre, fine.normal)
    lit = seen & (e > 0)

    def mean(values, chosen):
        count = np.bincount(fine.coarse, chosen)
        total = np.bincount(fine.coarse, np.where(chosen, values, 0.0))
        blur = random.normal(1, noise, len(count))
        return np.where(count > 0, blur * total / np.maximum(count, 1), np.nan)

    def every(values):
        return np.bincount(fine.coarse, values) / np.bincount(fine.coarse)

    n = fine.coarse.max() + 1
    coarse_f = np.zeros((n, n))
    np.add.at(coarse_f, (fine.coarse[:, None], fine.coarse[None]), F / 4)
    return MeasuredRoom(
        direct_over_irradiance=mean(rho * FLUX, lit),
        global_light=mean(rho * arriving, seen),
        irradiance=every(e),
        form_factors=coarse_f,
        reflectance=every(rho),
        face=np.round(every(fine.face)).astype(int),
    )


def fitted(room):
    return estimate_reflectance(room.direct_over_irradiance, room.global_light, room.irradiance, room.form_factors)


def test_reflectance_of_seen_patches_and_flux_are_found_in_a_closed_room():
    for seed in (1, 2, 3):
        room = measured(seed)
        fit = fitted(room)
        seen = fit.source != ReflectanceSource.UNSEEN
        assert np.sqrt(np.mean((fit.reflectance - room.reflectance)[seen] ** 2)) < 0.03
        assert fit.flux == pytest.approx(FLUX, rel=0.03)
        assert fit.unseen_reflectance == pytest.approx(room.reflectance[~seen].mean(), abs=0.06)


def test_the_truth_lies_within_three_of_the_stated_standard_deviations():
    errors = []
    for seed in range(4, 10):
        room = measured(seed)
        fit = fitted(room)
        errors.append(abs(fit.flux - FLUX) / fit.flux_sigma)
    assert max(errors) < 3


def test_each_patch_says_what_its_reflectance_rests_on():
    room = measured(1)
    fit = fitted(room)
    lit, seen = np.isfinite(room.direct_over_irradiance), np.isfinite(room.global_light)
    assert (fit.source[lit] == ReflectanceSource.DIRECT).all()
    assert (fit.source[seen & ~lit] == ReflectanceSource.GLOBAL).all()
    assert (fit.source[~seen] == ReflectanceSource.UNSEEN).all()
    assert fit.reflectance[~seen] == pytest.approx(fit.unseen_reflectance)


def test_patches_seen_in_the_light_of_others_only_get_their_own_reflectance():
    room = measured(1, noise=0.0)
    fit = fitted(room)
    only = fit.source == ReflectanceSource.GLOBAL
    assert only.any()
    assert np.sqrt(np.mean((fit.reflectance - room.reflectance)[only] ** 2)) < 0.04


def test_dark_things_in_a_room_do_not_make_its_unseen_walls_dark():
    bare = measured(1)
    lit = np.flatnonzero(np.isfinite(bare.direct_over_irradiance))
    dark = lit[:: len(lit) // 8][:8]
    for seed in (1, 2, 3):
        room = measured(seed, dark=dark)
        surface = room.face.copy()
        surface[dark] = 6 + np.arange(len(dark))
        fit = estimate_reflectance(
            room.direct_over_irradiance,
            room.global_light,
            room.irradiance,
            room.form_factors,
            wall=surface,
            alike=Alike.with_things(6, len(dark), backs=False),
        )
        assert fit.flux == pytest.approx(FLUX, rel=0.03)
        assert abs(fit.flux - FLUX) < 2 * fit.flux_sigma


@pytest.fixture(name="misjudged")
def misjudged_slants():
    """A room where every seventh lit patch gets 2.5 times the light that its slant says, which, and what is doubted."""
    room = measured(1)
    off = np.flatnonzero(np.isfinite(room.direct_over_irradiance) & np.isfinite(room.global_light))[::7]
    factor = np.ones(len(room.irradiance))
    factor[off] = 2.5
    wrong = replace(
        room, direct_over_irradiance=room.direct_over_irradiance * factor, irradiance=room.irradiance / factor
    )
    return wrong, off, np.where(factor > 1, 1.0, 0.0)


def test_where_a_patchs_slant_is_badly_known_global_light_tells_what_it_reflects(misjudged):
    room, off, error = misjudged
    arrays = room.direct_over_irradiance, room.global_light, room.irradiance, room.form_factors
    believed, doubted = estimate_reflectance(*arrays), estimate_reflectance(*arrays, irradiance_error=error)
    assert np.abs(believed.reflectance - room.reflectance)[off].mean() > 0.15
    left = doubted.reflectance - room.reflectance
    assert np.sqrt(np.mean(left[off] ** 2)) < 0.05
    assert np.mean(np.abs(left[off]) < 3 * doubted.sigma[off]) > 0.95
    assert doubted.flux == pytest.approx(FLUX, rel=0.03)
    assert doubted.global_rms < 0.3 * believed.global_rms


def test_a_patch_whose_slant_is_badly_known_sends_out_what_was_measured(misjudged):
    room, off, error = misjudged
    fit = estimate_reflectance(
        room.direct_over_irradiance, room.global_light, room.irradiance, room.form_factors, irradiance_error=error
    )
    sent = fit.reflectance * fit.lit_part * fit.flux * room.irradiance
    # 0.98 is the most that direct light is taken to tell
    measured_light = np.minimum(room.direct_over_irradiance, 0.98 * fit.flux) * room.irradiance
    assert sent[off] == pytest.approx(measured_light[off])
    assert (np.delete(fit.lit_part, off) == 1).all()


def test_where_all_that_is_lit_bends_the_flux_is_still_told_and_known_badly():
    room = measured(1)
    arrays = room.direct_over_irradiance, room.global_light, room.irradiance, room.form_factors
    fit = estimate_reflectance(*arrays, irradiance_error=np.ones(len(room.irradiance)))
    assert np.isfinite(fit.global_rms)
    assert abs(fit.flux - FLUX) < 3 * fit.flux_sigma
    assert fit.flux_sigma > 2 * fitted(room).flux_sigma


def test_without_doubt_of_slants_all_is_told_by_direct_light():
    room = measured(1)
    fit = fitted(room)
    lit = fit.source == ReflectanceSource.DIRECT
    assert fit.lit_part is None
    assert fit.reflectance[lit] * fit.flux == pytest.approx(room.direct_over_irradiance[lit])


def test_no_patch_both_lit_and_seen_is_refused():
    room = measured(1)
    nothing = np.full_like(room.global_light, np.nan)
    with pytest.raises(CalibrationError, match="both lit and seen"):
        estimate_reflectance(nothing, room.global_light, room.irradiance, room.form_factors)


def vignetting_errors(texture):
    """Largest error of the relative illumination of camera and projector, by a texture of the samples' places."""
    samples = box(0.04, 0.6)
    lit, e, projector_r = PROJECTOR(samples.centre, samples.normal)
    seen, _, camera_r = CAMERA(samples.centre, samples.normal)
    use = lit & seen
    rho = np.array([0.70, 0.71, 0.69, 0.68, 0.66, 0.76])[samples.face] * texture(samples.centre)
    camera = 1 - 0.22 * camera_r**2 + 0.03 * camera_r**4
    projector = 1 - 0.15 * projector_r**2
    gain = (FLUX * rho * e * camera * projector)[use]
    fit = fit_vignetting(gain, e[use], face=samples.face[use], camera_r=camera_r[use], projector_r=projector_r[use])
    r = np.linspace(0, 1, 11)
    lenses = ((fit.camera, (-0.22, 0.03)), (fit.projector, (-0.15, 0.0)))
    return [np.abs((found[0] - true[0]) * r**2 + (found[1] - true[1]) * r**4).max() for found, true in lenses]


def test_both_lenses_vignetting_is_told_apart():
    random = np.random.default_rng(11)
    assert max(vignetting_errors(lambda places: random.normal(1, 0.04, len(places)))) < 0.03


@pytest.mark.parametrize("seed", [0, 1, 3])
def test_smooth_texture_does_not_trade_one_lens_for_the_other(seed):
    random = np.random.default_rng(seed)

    def waves(places):
        three = (np.sin(places @ random.normal(0, 2.0, 3) + random.uniform(0, 6.28)) for _ in range(3))
        return 1 + 0.025 * sum(three)

    assert max(vignetting_errors(waves)) < 0.06


def test_a_model_in_which_pixels_see_other_places_than_their_code_says_is_refused() -> None:
    lit, on_model = np.ones((4, 5), bool), np.zeros((4, 5), bool)
    on_model[0] = True
    with pytest.raises(CalibrationError, match=r"only 25 % of the lit pixels .* at least 30 %"):
        on_model_of(lit, on_model)
    assert on_model_of(lit, lit).all()
