"""Each strategy on two patches, where its answer can be worked out by hand; what diverges; what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import csr_array

from sim.compensation import STRATEGIES, Strategy, compensate
from sim.compensation.spectrum import spectral_radius
from sim.compensation.split_transport import split_transport_of
from sim.errors import SimulationError
from sim.form_factors import FormFactors
from sim.light.colour import ColourTransport
from sim.light.radiosity import Radiosity
from sim.light.transport import LightTransport

G, D = 0.4, 0.5
BRIGHT = np.array([0.3, 0.05])
"""A first patch so bright that the second would have to swallow light."""
DIVERGING = 0.6
"""FormFactorOperator at which the global light is 1.5 times the direct."""


def two_patches(g: float, d: float = 0.5) -> LightTransport:
    """Two patches of 1 m² that face each other, one pixel on each.

    With G = [[0, g], [g, 0]], T = d / (1 - g²) [[1, g], [g, 1]] and T⁻¹ = [[1, -g], [-g, 1]] / d.
    """
    share = np.array([[0.0, g / 0.9], [g / 0.9, 0.0]])
    factors = FormFactors(
        matrix=share,
        areas=np.ones(2),
        row_sums=share.sum(axis=1),
        closure_max=0.0,
        method="by hand",
        visibility="none",
        seconds=0.0,
    )
    eye = csr_array(np.eye(2))
    return LightTransport(
        csr_array(d * np.eye(2)), csr_array(d * np.eye(2)), Radiosity(factors, 0.9), eye, pixel_patch=np.arange(2)
    )


@pytest.mark.parametrize("name", ["exact", "paper", "dual", "bounded", "reverse_radiosity", "tikhonov"])
def test_a_picture_within_reach_gets_the_inverse(name):
    target = np.array([0.3, 0.2])
    options = {"reverse_radiosity": {"tolerance": 1e-12}, "tikhonov": {"noise_rms": 1e-9}}.get(name, {})
    p = compensate(name, two_patches(G, D), target, **options).projector_image
    assert p == pytest.approx([(0.3 - G * 0.2) / D, (0.2 - G * 0.3) / D], rel=1e-6)


def test_direct_divides_by_direct_light_alone():
    assert compensate("direct", two_patches(G, D), [0.3, 0.2]).projector_image == pytest.approx([0.6, 0.4])


def test_reverse_radiosity_ends_where_each_pixel_is_at_a_bound_or_right():
    result = compensate("reverse_radiosity", two_patches(G, D), BRIGHT, tolerance=1e-12)
    assert result.projector_image == pytest.approx([0.3 * (1 - G**2) / D, 0.0], rel=1e-6)
    assert result.predicted[0] == pytest.approx(0.3, rel=1e-6)


def test_bounded_trades_one_error_against_the_other():
    # With p2 = 0 the best p1 is c . t / t . t, t = d / (1 - g²) (1, g).
    t = D / (1 - G**2) * np.array([1.0, G])
    result = compensate("bounded", two_patches(G, D), BRIGHT)
    assert result.projector_image == pytest.approx([BRIGHT @ t / (t @ t), 0.0], rel=1e-9)
    assert result.clipped.tolist() == [False, True]


def test_bounded_agrees_with_a_search_of_all_images():
    transport = two_patches(G, D)
    fine = np.linspace(0, 1, 2001)
    images = np.stack(np.meshgrid(fine, fine), axis=-1).reshape(-1, 2)
    T = transport @ np.eye(2)
    for target in (BRIGHT, [0.9, 0.1], [0.2, 0.9], [2.0, 2.0]):
        best = np.sqrt(((images @ T.T - target) ** 2).mean(axis=1).min())
        ours = compensate("bounded", transport, target).residual_rms
        assert best - 1e-3 <= ours <= best


@pytest.mark.parametrize("terms", [1, 2, 5])
def test_the_undamped_series_takes_a_bounce_away_a_term(terms):
    H = G / (1 - G**2) * np.array([[G, 1.0], [1.0, G]])
    target = np.array([0.3, 0.25])
    expected = sum(np.linalg.matrix_power(-H, k) @ target for k in range(terms)) / D
    p = compensate("series", two_patches(G, D), target, lower=-9.0, upper=9.0, terms=terms, damping=1.0).projector_image
    assert p == pytest.approx(expected)


def test_blocks_share_one_interreflection():
    # u_i = c_i - r mean(u), r = g / (1 - g) the sum of what comes back to a block of both patches.
    r, target = G / (1 - G), np.array([0.35, 0.25])
    result = compensate("block_fixed_point", two_patches(G, D), target, blocks=np.zeros(2, int), tolerance=1e-12)
    assert result.projector_image == pytest.approx((target - r * target.mean() / (1 + r)) / D, rel=1e-6)


def test_tikhonov_leaves_the_noise_and_no_more():
    # A uniform image has the singular value d / (1 - g): p = t c / (t² + λ²).
    t, target = D / (1 - G), np.full(2, 0.3)
    result = compensate("tikhonov", two_patches(G, D), target, noise_rms=0.03)
    damped = t / (t**2 + result.notes["regularisation"] ** 2)
    assert result.projector_image == pytest.approx(damped * target, rel=1e-3)
    assert 0.027 <= result.residual_rms <= 0.03


def test_remap_finds_the_largest_gain_by_hand():
    # c = (1, 0): s + o (1 - g) <= d and o (1 - g) >= g s.
    result = compensate("remap", two_patches(G, D), [1.0, 0.0])
    assert result.notes["gain"] == pytest.approx(D / (1 + G), rel=1e-9)
    assert result.notes["offset"] == pytest.approx(G * D / (1 + G) / (1 - G), rel=1e-9)
    assert result.projector_image == pytest.approx([1.0, 0.0], abs=1e-9)
    assert result.predicted == pytest.approx(result.notes["gain"] * np.array([1.0, 0.0]) + result.notes["offset"])


def test_remap_leaves_a_picture_alone_that_fits():
    result = compensate("remap", two_patches(G, D), [0.3, 0.2])
    assert (result.notes["gain"], result.notes["offset"]) == (1.0, 0.0)
    assert result.predicted == pytest.approx([0.3, 0.2])


def test_remap_says_by_how_much_no_gain_stays_in_range():
    # Without direct light no offset lifts the image to the range's lower end.
    result = compensate("remap", two_patches(G, 0.0), [0.3, 0.2], lower=0.1, upper=0.8)
    assert result.notes["out_of_range"] == pytest.approx(0.1 / 0.7)
    assert result.projector_image.tolist() == [0.1, 0.1]


def test_smooth_attenuation_without_positions_is_one_number_that_balances():
    # Minimise (1 - s)² + w (s p - 1)² for the image p > 1 that the target would take.
    target = np.full(2, 1.2)
    p, w = 1.2 * (1 - G) / D, 30.0
    result = compensate("smooth_attenuation", two_patches(G, D), target, in_range=w)
    assert result.notes["attenuation_mean"] == pytest.approx((1 + w * p) / (1 + w * p**2), rel=1e-5)


def test_content_scale_dims_until_white_is_hardly_clipped():
    transport, target = two_patches(G, D), np.full(2, 1.2)
    p = 1.2 * (1 - G) / D
    gain = compensate("content_scale", transport, target).notes["gain"]
    # Just visible: Weber's 2 % of the light that clamping takes away.
    assert gain == pytest.approx(1 / (p * (1 - 0.02)), rel=1e-3)
    assert compensate("content_scale", transport, target / 2).notes["gain"] == 1.0


@pytest.mark.parametrize("g", [0.2, G, DIVERGING])
def test_the_spectral_radius_is_that_of_all_bounces(g):
    assert spectral_radius(split_transport_of(two_patches(g, D))) == pytest.approx(g / (1 - g), rel=1e-5)


@pytest.mark.parametrize("name", ["series", "reverse_radiosity", "block_fixed_point"])
def test_what_would_diverge_is_refused_undamped_with_the_radius_and_damped_otherwise(name):
    transport, target = two_patches(DIVERGING, D), np.array([0.3, 0.25])
    with pytest.raises(SimulationError, match=r"spectral radius 1\.500 .* between 0 and 0\.800"):
        compensate(name, transport, target, damping=1.0)
    result = compensate(name, transport, target)
    assert result.notes["undamped"].startswith("would diverge: spectral radius 1.500")
    assert result.residual_rms < 0.01


def test_a_strategy_says_when_direct_is_better_and_only_then():
    transport = two_patches(0.01, D)
    assert "worse_than_direct" not in compensate("exact", transport, [0.45, 0.4]).notes
    too_bright = np.array([5.0, 0.2])
    direct = compensate("direct", transport, too_bright)
    for name in STRATEGIES:
        result = compensate(name, transport, too_bright)
        errors = [np.abs(each.predicted - too_bright) for each in (result, direct)]
        worse = max(errors[0].mean() / errors[1].mean(), result.residual_rms / direct.residual_rms)
        assert result.notes.get("worse_than_direct", 1.0) == pytest.approx(max(worse, 1.0), rel=2e-6), name
    assert compensate("remap", transport, too_bright).notes["worse_than_direct"] > 1.04


MIXING = np.array([[0.9, 0.1], [0.2, 0.8]])


@pytest.mark.parametrize("name", STRATEGIES)
def test_bands_that_do_not_mix_are_compensated_each_on_its_own(name):
    # Strategies with one number for the whole picture see the same picture in both bands.
    grey, target = two_patches(G, D), np.array([0.3, 0.2])
    colour = ColourTransport((grey, grey), np.eye(2))
    if name == "perceptual":
        with pytest.raises(SimulationError, match="2 bands"):
            compensate(name, colour, np.stack([target, target], axis=1))
        return
    ours = compensate(name, colour, np.stack([target, target], axis=1)).projector_image
    alone = compensate(name, grey, target).projector_image
    assert ours == pytest.approx(np.stack([alone, alone], axis=1), rel=1e-3)


@pytest.mark.parametrize("name", ["exact", "paper", "dual", "series", "bounded", "reverse_radiosity", "tikhonov"])
def test_mixed_channels_are_unmixed(name):
    colour = ColourTransport((two_patches(G, D), two_patches(0.2, D)), MIXING)
    wanted = np.array([[0.5, 0.3], [0.4, 0.6]])
    result = compensate(name, colour, colour.forward(wanted))
    assert result.projector_image == pytest.approx(wanted, abs=0.01)
    assert result.projector_image.shape == result.predicted.shape == result.clipped.shape == (2, 2)


@pytest.mark.parametrize("name", STRATEGIES)
def test_targets_that_do_not_fit_are_refused(name):
    grey = two_patches(G, D)
    colour = ColourTransport((grey, grey), np.eye(2))
    for transport, target in ((grey, np.ones(3)), (grey, np.ones((2, 1))), (colour, np.ones(2)), (colour, np.ones(4))):
        with pytest.raises(SimulationError, match="target of shape"):
            compensate(name, transport, target)
    with pytest.raises(SimulationError, match="1 of 2 values not finite"):
        compensate(name, grey, [0.1, np.inf])
    with pytest.raises(SimulationError, match="is empty"):
        compensate(name, grey, [0.1, 0.1], lower=1.0, upper=1.0)


@pytest.mark.parametrize(
    ("name", "options", "words"),
    [
        ("series", {"terms": 0}, "at least 1"),
        ("series", {"damping": -0.5}, "between 0 and"),
        ("block_fixed_point", {"blocks": [0]}, "one whole number a pixel"),
        ("block_fixed_point", {"blocks": [0.0, 1.0]}, "one whole number a pixel"),
        ("tikhonov", {"noise_rms": 0.0}, "give the measured noise"),
        ("tikhonov", {"noise_rms": float("nan")}, "give the measured noise"),
        ("perceptual", {"white": 0.0}, "above 0"),
        ("smooth_attenuation", {"smoothness": 0.0}, "both above 0"),
        ("bounded", {"adjustment": "moon"}, "unknown adjustment 'moon'; there are none, remap"),
    ],
)
def test_options_out_of_their_limits_are_refused(name, options, words):
    with pytest.raises(SimulationError, match=words):
        compensate(name, two_patches(G, D), [0.3, 0.2], **options)


# What is asked: one door for all


@pytest.mark.parametrize("name", list(STRATEGIES))
@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (np.nan, "1 of 2 values of its direct light are NaN, infinite"),
        (np.inf, "1 of 2 values of its direct light are NaN, infinite"),
        (1e200, "above 1e[+]60"),
    ],
)
def test_a_transport_that_is_not_finite_is_refused_by_every_strategy(name, spoil, words):
    transport = two_patches(G, D)
    transport.direct_matrix.data[0] = spoil
    with pytest.raises(SimulationError, match=words):
        compensate(name, transport, [0.3, 0.2])


@pytest.mark.parametrize("name", list(STRATEGIES))
@pytest.mark.parametrize(
    ("target", "words"),
    [
        ([np.nan, 0.2], "1 of 2 values not finite"),
        ([np.inf, 0.2], "1 of 2 values not finite"),
        (
            [1e200, 0.2],
            "values up to 1e[+]200, where the brightest direct light is 0.5; give it in the transport's unit",
        ),
        ([1e-300, 0.0], "values up to 1e-300"),
    ],
)
def test_a_target_in_no_unit_of_the_transport_is_refused_by_every_strategy(name, target, words):
    with pytest.raises(SimulationError, match=words):
        compensate(name, two_patches(G, D), target)


@pytest.mark.parametrize("name", list(STRATEGIES))
def test_a_black_target_is_black_for_every_strategy(name):
    assert np.isfinite(compensate(name, two_patches(G, D), [0.0, 0.0]).projector_image).all()


@pytest.mark.parametrize(("lower", "upper"), [(0.0, np.inf), (-np.inf, 1.0), (np.nan, 1.0), (1.0, 0.0)])
def test_a_range_that_is_none_is_refused(lower, upper):
    with pytest.raises(SimulationError, match=r"projector range|give a finite number"):
        compensate("bounded", two_patches(G, D), [0.3, 0.2], lower=lower, upper=upper)


def test_an_answer_that_is_not_finite_is_refused_with_the_name_of_its_strategy():
    def broken(transport, target, lower, upper):
        return replace(compensate("direct", transport, target), projector_image=np.array([np.nan, 0.0]))

    with pytest.raises(SimulationError, match="strategy broken: 1 of 2 values of its picture are NaN"):
        Strategy(name="broken", solve=broken, summary="of another package").compensate(two_patches(G, D), [0.3, 0.2])
