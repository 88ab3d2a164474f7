"""Paints and projectors come with who says so."""

import re

import pytest

from rig.plan.compute import plan_room
from rig.plan.paints import chosen_paint, known_paints
from rig.plan.request import NamedPaint
from tests.rig.plan.rooms import projector, room


def test_every_cited_paint_stands_in_the_words_that_are_quoted() -> None:
    file = known_paints()
    assert len(file.paints) >= 8
    for name, fact in file.paints.items():
        numbers = {float(text) for text in re.findall(r"\d*\.?\d+", fact.quote)}
        assert numbers & {fact.value, round(100 * fact.value, 6)}, name
        assert fact.source in file.sources


def test_munsell_greys_reflect_what_the_standard_says() -> None:
    # Values of the documentation of colour-science, and the end of the scale.
    assert chosen_paint("munsell-n4.08244375", (), "wall").reflectance == pytest.approx(0.122363426)
    assert chosen_paint("munsell-n9.5", (), "wall").reflectance == pytest.approx(0.8780, abs=2e-3)


def test_ones_own_paint_goes_first_and_keeps_its_price() -> None:
    own = NamedPaint(name="pure-white", reflectance=0.8, cost=3.0, source="our meter")
    chosen = chosen_paint("pure-white", (own,), "wall")
    assert (chosen.reflectance, chosen.cost, chosen.source) == (0.8, 3.0, "our meter")


def test_the_cost_of_paint_is_area_times_price_without_openings() -> None:
    paint = {"name": "dear", "reflectance": 0.5, "cost": 10.0}
    door = {"name": "door", "surface": "y0", "from_m": [1, 0], "to_m": [2, 2], "paint": 0.4}
    result = plan_room(room(paint={"all": 0.5, "walls": "dear"}, named_paint=[paint], opening=[door]))
    assert result.totals.paint_cost == pytest.approx(10 * (4 * 4.8 * 2.4 - 2.0))


def test_numbers_of_a_model_are_quoted_and_those_of_the_file_go_first() -> None:
    numbers = plan_room(room(projector=CITED)).projectors[0]
    assert (numbers.lumens, numbers.contrast, numbers.width_px) == (3800.0, 1000.0, 1920)
    assert numbers.throw_ratio == pytest.approx(1.118 / 2.214)
    said = " ".join(numbers.said)
    assert "listed light output of 3,800 lumens" in said
    assert "claims; measured ones are mostly lower" in said
    assert "contrast 1000: nobody has measured it, this is a guess" in said
    given = plan_room(room(projector={**CITED, "lumens": 2500, "contrast": 500})).projectors[0]
    assert (given.lumens, given.contrast) == (2500.0, 500.0)
    assert not any("lm:" in text for text in given.said)


CITED = {"model": "GT1080HDR", "position_m": [1.2, 1.2, 1.2], "look_at_m": [2.2, 2.2, 1.1]}


def test_a_measured_contrast_is_believed_before_a_claimed_one() -> None:
    asked = projector(model="LG PF1000U")
    asked = {key: value for key, value in asked.items() if key not in ("contrast", "lumens")}
    numbers = plan_room(room(projector=asked)).projectors[0]
    assert (numbers.contrast, numbers.lumens) == (381.0, 1021.0)
