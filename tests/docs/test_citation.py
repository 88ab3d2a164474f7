"""CITATION.cff parses, says what the package says, and names the article."""

import datetime
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).parents[2]
PAPER = "10.1007/s10055-013-0233-x"


@pytest.fixture
def citation() -> dict[str, Any]:
    return yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))


def test_it_has_what_the_format_requires(citation: dict[str, Any]) -> None:
    assert citation["cff-version"] == "1.2.0"
    assert all(isinstance(citation[key], str) for key in ("message", "title"))
    assert citation["authors"]
    assert isinstance(citation["date-released"], datetime.date)


def test_it_says_what_the_package_says(citation: dict[str, Any]) -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    said = {"name": citation["title"], "license": citation["license"]}
    assert said == {key: project[key] for key in said}
    assert citation["keywords"] == project["keywords"]


def test_it_cites_the_last_version_that_was_released(citation: dict[str, Any]) -> None:
    released = re.findall(r"^## \[(\d+\.\d+\.\d+)\]", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert citation["version"] == released[0]


def test_the_version_and_its_date_stand_in_the_changes(citation: dict[str, Any]) -> None:
    heading = f"## [{citation['version']}] - {citation['date-released']}\n"
    assert heading in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_it_names_the_article(citation: dict[str, Any]) -> None:
    (article,) = [one for one in citation["references"] if one.get("doi") == PAPER]
    assert article["type"] == "article"
    assert article["authors"][0]["family-names"] == "Dehos"
    assert f"doi.org/{PAPER}" in (ROOT / "README.md").read_text(encoding="utf-8")
