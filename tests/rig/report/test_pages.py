"""Pages of a session: what they name, explain, link and let enlarge; what they recommend."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from rig.cli.app import run_command
from rig.plug_ins import names, own_strategies
from rig.records import Verdict
from rig.report.links import link_pages
from rig.report.page import write_report
from rig.report.terms import STRATEGIES, explanation, name_of
from rig.run.results import session_result
from rig.session import Session
from rig.stages.stripes.showing import focus_verdicts
from rig.strategies.recommendation import recommendation
from rig.strategies.records import ClosedLoop, ComparedPicture, ComparisonResult, JudgedErrors, StrategyRow

if TYPE_CHECKING:
    from tests.rig.conftest import Finished


@pytest.fixture(scope="module")
def page(finished: Finished) -> str:
    return (finished.folder / "report.html").read_text("utf-8")


def text_of(page: str) -> str:
    """What a reader sees, without pictures."""
    plain = re.sub(r"<(script|style)>.*?</\1>", " ", page, flags=re.DOTALL)
    return " ".join(re.sub(r"<[^>]*>", " ", plain).split())


def test_every_strategy_has_one_name_and_a_sentence(page: str) -> None:
    known = names("strategy", own_strategies())
    assert set(STRATEGIES) == set(known)
    text = text_of(page)
    assert "exact inverse" not in text
    assert "direct only" not in text
    for name in ("none", "direct", "paper", "exact", "bounded"):
        assert f'<abbr title="{explanation(name)}">{name}</abbr>' in page


def test_every_head_of_a_table_is_explained_on_hover_and_in_the_list_of_words(page: str) -> None:
    heads = re.findall(r"<th[^>]*>(.*?)</th>", page)
    explained = [head for head in heads if "<abbr" in head]
    assert len(explained) >= 12
    words = re.findall(r"<dt>(.*?)</dt>", page)
    for word in ("SSIM", "rms", "clipped, %", "bounded", "within 3 σ, %", "lamp: drift of white"):
        assert word in words


def test_every_row_that_is_judged_is_explained(finished: Finished) -> None:
    rows = json.loads((finished.folder / "metrics.json").read_text("utf-8"))["limits"]
    assert len(rows) > 8
    assert [row["what"] for row in rows if not explanation(row["what"])] == []


def test_the_page_names_walls_scales_and_the_command_that_was_used(page: str, finished: Finished) -> None:
    text = text_of(page)
    assert f"rig run {finished.folder} -p ci-tiny --json" in text
    for alt in ("Grey scale of the light", "Colour scale of the picture above", "Colour scale of the errors"):
        assert alt in page
    with Session.read(finished.folder) as session:
        assert session.commands == [f"rig run {finished.folder} -p ci-tiny --json"]


@pytest.mark.parametrize(
    ("key", "words"),
    [
        ("camera_position_mm", "camera position [mm]"),
        ("focal_percent", "focal length [%]"),
        ("reflectance_rmse_lit_and_seen", "reflectance rms error lit and seen"),
        ("patches", "patches"),
        ("s", "s"),
    ],
)
def test_a_key_of_a_result_is_a_name_with_its_unit_where_people_read_it(key: str, words: str) -> None:
    assert name_of(key) == words


def test_a_page_needs_nothing_from_elsewhere_and_has_no_inline_handlers(page: str) -> None:
    assert not re.findall(r"<(?:script|link|img)[^>]*(?:src|href)=\"(?!data:)[^\"]*\"", page)
    assert not re.findall(r"\son[a-z]+=", re.sub(r"<script>.*?</script>", "", page, flags=re.DOTALL))
    assert page.count("<script>") == 2, "the page's own, and the view of the room"


def test_a_failed_limit_stands_in_the_verdict_with_what_to_do(finished: Finished, tmp_path: Path) -> None:
    folder = shutil.copytree(finished.folder, tmp_path / "session")
    profile = tmp_path / "strict.toml"
    raw = (folder / "profile.toml").read_text("utf-8")
    profile.write_text(raw.replace("valid_share = 0.8", "valid_share = 1.0").replace("rms_px = 0.5", "rms_px = 0.02"))
    assert run_command(["run", str(folder), "-p", str(profile)]) == 1
    page = (folder / "report.html").read_text("utf-8")
    verdict = text_of(page[page.index('<div class="verdict">') : page.index("<section>")])
    assert "Outside limits" in verdict
    assert "geometry: reprojection rms: 0." in verdict
    assert "(at most 0.02)" in verdict
    assert "nothing may move while it is calibrated" in verdict


def test_a_number_to_know_and_one_that_could_not_be_measured_stand_among_the_limits(
    finished: Finished, tmp_path: Path
) -> None:
    folder = shutil.copytree(finished.folder, tmp_path / "session")
    unmeasured = Verdict(what="something else", value=None, limit=0.5, advice="look for it")
    with Session.open(folder) as session:
        result = session_result(session, None)
        result = replace(result, limits=(*focus_verdicts(4), unmeasured, *result.limits))
        text = text_of(write_report(session, result, lambda *_: None).read_text("utf-8"))
    assert "stripes of the code, wider than usual 4 – times info" in text
    assert "something else – 0.5 not measured look for it" in text


def test_guesses_of_the_profile_are_named(finished: Finished, tmp_path: Path) -> None:
    folder = shutil.copytree(finished.folder, tmp_path / "session")
    profile = tmp_path / "guessed.toml"
    raw = (folder / "profile.toml").read_text("utf-8")
    profile.write_text(raw.replace("distance_m = 4.876", "distance_m = 4.876  # MEASURE: by tape"))
    assert run_command(["run", str(folder), "-p", str(profile)]) in (0, 1)
    text = text_of((folder / "report.html").read_text("utf-8"))
    assert "Still guesses in the profile (MEASURE): scale.distance_m." in text


def test_pages_of_a_folder_link_to_each_other_and_to_none_that_is_missing(tmp_path: Path) -> None:
    nav = '<nav class="pages"><!--pages--><!--/pages--></nav>'
    for name in ("report.html", "strategies.html"):
        (tmp_path / name).write_text(f"<p>{name}</p>{nav}<p>end</p>", encoding="utf-8")
    link_pages(tmp_path)
    report = (tmp_path / "report.html").read_text("utf-8")
    assert '<a href="strategies.html">Strategies side by side</a>' in report
    assert "check.html" not in report
    (tmp_path / "check.html").write_text(f"{nav}", encoding="utf-8")
    link_pages(tmp_path)
    link_pages(tmp_path)
    assert (tmp_path / "report.html").read_text("utf-8").count("<a ") == 2
    assert (tmp_path / "check.html").read_text("utf-8").count("<a ") == 2
    (tmp_path / "strategies.html").unlink()
    link_pages(tmp_path)
    assert "strategies.html" not in (tmp_path / "report.html").read_text("utf-8")


# The recommendation


def row(
    name: str, mean: float, *, seconds: float = 1.0, clipped: float = 0.0, at_best: float | None = None
) -> StrategyRow:
    errors = JudgedErrors(
        mean=mean, sd=1.0, max=9.0, rms=mean, bias=0.0, ssim=0.9, delta_e_2000=1.0, best_gain=1.0,
        mean_at_best_gain=mean if at_best is None else at_best, mean_sigma=0.01,
    )  # fmt: skip
    return StrategyRow(strategy=name, measured=errors, seconds=seconds, clipped_share=clipped)


def advice(*rows: StrategyRow, loops: tuple[ClosedLoop, ...] = ()) -> str:
    picture = ComparedPicture(name="target", title="a picture", rows=rows)
    result = ComparisonResult(pictures=(picture,), loops=loops, ratios={}, warnings=())
    return " ".join(recommendation(result))


def test_the_least_error_is_recommended_and_said_why() -> None:
    said = advice(row("none", 40), row("exact", 9, seconds=0.1), row("bounded", 5, seconds=2, clipped=0.24))
    assert said.startswith("Use bounded: photographed, it leaves a mean error of 5.0 grey levels, 8.0 times less")
    assert "Next is exact with 9.0." in said
    assert "24 % of the projector's pixels are at black or at white already" in said


def test_of_two_that_no_eye_tells_apart_the_faster_one_is_recommended() -> None:
    said = advice(row("none", 40), row("dual", 5.00, seconds=9), row("bounded", 5.05, seconds=1))
    assert said.startswith("Use bounded:")


def test_where_nothing_helps_that_is_said() -> None:
    assert advice(row("none", 5.0), row("bounded", 4.8)).startswith("Compensation hardly helps here")


def test_a_darker_truer_picture_and_a_loop_are_named_where_they_are_worth_it() -> None:
    rows = (row("none", 40), row("bounded", 5, at_best=4.9), row("content_scale", 20, at_best=3.0))
    assert "content_scale keeps it truer" in advice(*rows)
    loop = ClosedLoop(
        strategy="bounded", rule="image", damping=0.5, best=1, stopped="end",
        captures=(replace(rows[1].shown, mean=3.0),),
    )  # fmt: skip
    assert "close the loop over the camera: bounded corrected by 1 photograph leaves 3.0" in advice(
        *rows, loops=(loop,)
    )
    weak = replace(loop, captures=(replace(rows[1].shown, mean=4.9),))
    assert "gains little here" in advice(*rows, loops=(weak,))
