"""``rig paper``: the published figures, within what unpublished poses and photographs allow."""

import json

import numpy as np
import pytest

from rig.workflows.paper import paper_table, run_paper
from rig.workflows.paper_checks import exceptions, published_effects
from rig.workflows.paper_photographs import PHOTOGRAPHS, photograph, rescaled


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    return run_paper(tmp_path_factory.mktemp("figures") / "new", lambda *step: None)


def _configuration(result, name):
    return next(c for c in result["configurations"] if c["name"] == name)


def test_the_six_configurations_come_in_order_and_as_json(result):
    names = [c["name"] for c in result["configurations"]]
    assert names == ["reference", "indoor", "grey", "quarter", "no_ceiling", "dark_walls"]
    json.dumps(result)


def test_the_papers_quadrature_is_the_papers(result):
    assert result["row_sums"]["min"] == pytest.approx(1.0004, abs=5e-5)
    assert result["row_sums"]["max"] == pytest.approx(1.0869, abs=5e-5)
    assert result["spectral_radius"] == pytest.approx(1.0197, abs=5e-5)


def test_the_reference_comes_within_five_grey_levels_and_is_improved(result):
    reference = _configuration(result, "reference")
    means = {name: error["mean"] for name, error in reference["strategies"].items()}
    assert reference["error_uncompensated"]["mean"] == pytest.approx(32, abs=5)
    assert means["paper"] == pytest.approx(27, abs=5)
    assert means["exact"] < means["paper"]
    assert means["bounded"] <= 0.7 * means["paper"]


def test_uniform_grey_comes_within_five_grey_levels_and_exact(result):
    strategies = _configuration(result, "grey")["strategies"]
    assert strategies["paper"]["mean"] == pytest.approx(21, abs=5)
    assert strategies["exact"]["mean"] <= 0.1
    assert strategies["bounded"]["mean"] <= 0.1


def test_the_poses_light_the_published_shares_of_the_room(result):
    assert _configuration(result, "reference")["coverage"] == pytest.approx(0.5, abs=0.06)
    assert result["coverage_quarter"] == pytest.approx(0.25, abs=0.02)


def test_every_published_effect_is_reproduced_or_explained(result):
    missing = [effect for effect in result["effects"] if not effect["reproduced"]]
    assert len(result["effects"]) == 14
    assert len(result["exceptions"]) == len(missing) <= 2


def test_bounded_has_the_smallest_rms_everywhere(result):
    for configuration in result["configurations"]:
        rms = {name: error["rms"] for name, error in configuration["strategies"].items()}
        assert rms["bounded"] <= min(rms.values()) * 1.001


def test_figures_are_written_and_listed(result):
    assert len(result["figures"]) == 12
    assert all(path.endswith(".png") for path in result["figures"])


def test_the_table_has_ours_and_theirs_for_each_configuration(result):
    assert paper_table(result).row_count == 12


def test_an_effect_the_wrong_way_round_is_explained_with_its_figures(result):
    configurations = {c["name"]: dict(c) for c in result["configurations"]}
    configurations["indoor"]["error_uncompensated"] = {"mean": 99.0, "sd": 1.0, "max": 99.0, "rms": 99.0}
    sentences = exceptions(published_effects(configurations))
    assert any("indoor" in sentence and "99 against" in sentence for sentence in sentences)


@pytest.mark.parametrize("name", PHOTOGRAPHS)
def test_photographs_have_the_published_statistics(name):
    image = photograph(name, (120, 160))
    assert image.shape == (120, 160)
    assert image.mean() == pytest.approx(PHOTOGRAPHS[name].mean, abs=0.1)
    assert image.std() == pytest.approx(PHOTOGRAPHS[name].sd, abs=0.1)
    assert image.min() >= 0
    assert image.max() <= 255


def test_rescaling_reaches_the_wanted_deviation_in_spite_of_the_range():
    ramp = np.linspace(0, 255, 1000)
    assert rescaled(ramp, 102, 52).std() == pytest.approx(52, abs=0.1)
