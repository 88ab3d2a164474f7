"""What a notebook shows: results as tables, a bar, a session's pictures."""

from html.parser import HTMLParser
from pathlib import Path

import pytest

import rig
from rig.errors import SessionError
from rig.records import Verdict
from rig.sweeps.records import FigureSpread, SweepResult


def tags_of(html: str) -> list[str]:
    found = []
    parser = HTMLParser()
    parser.handle_starttag = lambda tag, attributes: found.append(tag)
    parser.feed(html)
    return found


def test_a_record_shows_each_field_in_a_row_and_escapes_what_it_holds():
    shown = Verdict(what="<b>noise</b>", value=1.25, limit=2.0)._repr_html_()
    assert "&lt;b&gt;noise" in shown
    assert "1.25" in shown
    assert tags_of(shown).count("tr") == 8


def test_records_within_records_are_tables_within_tables():
    spread = FigureSpread(figure="error", points=3, min=0.0, tenth=0.1, median=1 / 3, ninetieth=0.9, max=1.0)
    fields = dict.fromkeys(("title", "subject", "version", "folder"), "x")
    counts = dict.fromkeys(("points", "computed_now", "computed_before", "refused", "killed", "left", "others"), 3)
    shown = SweepResult(**fields, **counts, spreads=(spread,) * 20)._repr_html_()
    assert "0.33333" in shown
    assert "8 more" in shown


def test_a_bar_is_written_over_until_the_next_step(monkeypatch):
    shown = []

    class Handle:
        def update(self, bar):
            shown[-1] = bar.data

    def display(bar, display_id):
        shown.append(bar.data)
        return Handle()

    monkeypatch.setattr("IPython.display.display", display)
    progress = rig.NotebookProgress()
    for k in range(11):
        progress("points", k, 10)
    assert shown == ["<progress value='10' max='10'></progress> points 10 of 10"]


def test_pictures_of_a_session_that_compared_nothing_are_refused(tmp_path: Path):
    with rig.Session.open(tmp_path / "new", rig.load_profile("ci-tiny")):
        pass
    with pytest.raises(SessionError, match="nothing was compared yet"):
        rig.session_pictures(tmp_path / "new")


def test_pictures_of_a_session_are_five_a_strategy(finished):
    shown = rig.session_pictures(finished.folder)
    assert tags_of(shown._repr_html_()).count("img") == 5 * len(shown.rows)
