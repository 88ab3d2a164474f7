"""Decisions: each has a number, a date and a status; relations hold in both directions; the index lists all."""

import datetime
import re
from dataclasses import dataclass
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "docs" / "decisions"
TITLE = re.compile(r"^# (\d+)\. (.+)\n\n")
STATUS = re.compile(r"^\*\*Status\*\* (\d{4}-\d\d-\d\d), (.+)$", re.MULTILINE)
LINK = r"\[(\d+)\]\(([^)]+)\)"
REMARK = re.compile(r" \([^()]*\)(?=[,;]|$)")
"""What exactly was changed, in brackets behind a link; the index leaves it out."""
WORDS = re.compile(
    rf"accepted(, (amended|overruled) by {LINK})*(; (amends|overrules) {LINK}(, {LINK})*)*"
    rf"|overruled by {LINK}(; (amends|overrules) {LINK}(, {LINK})*)*"
)


@dataclass(frozen=True)
class Decision:
    """What the head of a page says."""

    file: str
    number: int
    title: str
    date: datetime.date
    status: str

    @property
    def row(self) -> str:
        return f"| {self.number} | [{self.title}]({self.file}) | {self.date} | {self.status} |"

    def related(self, verb: str) -> set[int]:
        """Numbers that follow a verb in the status."""
        parts = re.findall(rf"{verb} ((?:{LINK}(?:, )?)+)", self.status)
        return {int(number) for part, *_ in parts for number, _ in re.findall(LINK, part)}


def read(path: Path) -> Decision:
    text = path.read_text(encoding="utf-8")
    title, status = TITLE.match(text), STATUS.search(text)
    assert title, f"{path.name}: begin with '# NUMBER. TITLE' and an empty line"
    assert status, f"{path.name}: say '**Status** YEAR-MONTH-DAY, accepted'"
    date = datetime.date.fromisoformat(status[1])
    return Decision(path.name, int(title[1]), title[2], date, REMARK.sub("", status[2]))


PAGES = sorted(FOLDER.glob("0*.md"))


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.name)
def test_a_page_has_number_date_and_status(path: Path) -> None:
    decision = read(path)
    assert decision.file.startswith(f"{decision.number:04}-")
    assert WORDS.fullmatch(decision.status), decision.status
    assert all((FOLDER / file).is_file() and int(file[:4]) == int(n) for n, file in re.findall(LINK, decision.status))


def test_numbers_follow_each_other_and_so_do_dates() -> None:
    decisions = [read(path) for path in PAGES]
    assert [one.number for one in decisions] == list(range(1, len(PAGES) + 1))
    assert [one.date for one in decisions] == sorted(one.date for one in decisions)


@pytest.mark.parametrize(("later", "earlier"), [("amends", "amended by"), ("overrules", "overruled by")])
def test_what_a_later_page_changes_says_so_and_the_other_way_round(later: str, earlier: str) -> None:
    decisions = [read(path) for path in PAGES]
    forwards = {(one.number, other) for one in decisions for other in one.related(later)}
    backwards = {(other, one.number) for one in decisions for other in one.related(earlier)}
    assert forwards == backwards
    assert all(new > old for new, old in forwards)


def test_the_index_has_a_line_for_each_page() -> None:
    index = (FOLDER / "index.md").read_text(encoding="utf-8")
    rows = [line for line in index.splitlines() if re.match(r"\| \d", line)]
    assert rows == [read(path).row for path in PAGES]
