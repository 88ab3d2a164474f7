"""Every fenced block of every page is run or checked, in the order in which a reader meets it."""

import json
import re
import runpy
import shlex
import tomllib
from pathlib import Path
from typing import Any

import pytest
from sybil import Document, Example
from sybil.evaluators.python import PythonEvaluator
from sybil.parsers.markdown import CodeBlockParser

from rig import open_rig
from rig.cli.app import run_command
from rig.devices.replay.photographs import load_manifest
from rig.lenses.manifest import load_lens_manifest
from rig.plan.request import request_of
from rig.profile.schema import Profile
from rig.sweeps.design import settings_of
from rig.sweeps.study import read_study
from rig.sweeps.subjects import subject_of

ROOT = Path(__file__).parents[2]
PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    ROOT / "CHANGELOG.md",
    ROOT / "tests" / "README.md",
    *sorted((ROOT / "docs").rglob("*.md")),
]
QUICK = {"sim-room": "ci-tiny", "hw_profiles/sim-room.toml": "ci-tiny"}
"""Pages name the room that people look at; the tests take the same room at few pixels."""
RUN = re.compile(r"^```(python|console|bash|toml|json)", re.MULTILINE)
FENCE = re.compile(r"^```([a-z]*)[^\n]*\n", re.MULTILINE)
LINK = re.compile(r"\]\(([^)\s]+)\)")
NOT_A_FILE = ("http://", "https://", "#")
SOUND = {0, 1}
"""Exit status: 1 says that a result is outside its limits, which is a result."""


def name_of(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


@pytest.mark.slow
@pytest.mark.parametrize("page", [p for p in PAGES if RUN.search(p.read_text("utf-8"))], ids=name_of)
def test_every_block_of_the_page_runs(page: Path, reader: Path, capsys: pytest.CaptureFixture[str]) -> None:
    document = blocks_of(page)
    document.namespace["_capsys"] = capsys
    for example in document.examples():
        example.evaluate()


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_every_block_names_a_language_that_is_checked(page: Path) -> None:
    languages = FENCE.findall(page.read_text(encoding="utf-8"))[::2]
    assert set(languages) <= {"python", "console", "bash", "toml", "json", "text"}


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_links_lead_somewhere(page: Path) -> None:
    targets = LINK.findall(page.read_text(encoding="utf-8"))
    files = [target.partition("#")[0] for target in targets if not target.startswith(NOT_A_FILE)]
    assert [file for file in files if not (page.parent / file).exists()] == []


def test_the_tutorials_session_has_at_most_fifteen_lines() -> None:
    page = (ROOT / "docs/tutorials/first-session.md").read_text(encoding="utf-8")
    script = page.split("```python\n")[1].split("```")[0]
    assert 5 < len(script.strip().splitlines()) <= 15
    assert script.count("ci-tiny") == 1


def test_a_json_block_that_shows_keys_that_do_not_exist_is_found() -> None:
    assert missing_keys({"a": 1, "b": {"c": 2}}, {"a": 3, "b": {}}) == ["b.c"]


def blocks_of(page: Path) -> Document:
    """A page with all its executable blocks, in order."""
    parsers = [
        CodeBlockParser("python", PythonEvaluator()),
        CodeBlockParser("console", run_console),
        CodeBlockParser("bash", check_shell),
        CodeBlockParser("toml", check_toml),
        CodeBlockParser("json", lambda example: json.loads(example.parsed) and None),
    ]
    return Document.parse(str(page), *parsers)


def run_console(example: Example) -> None:
    """Run each `$ rig …`; what the page shows below it, if JSON, has to have the keys of the real answer."""
    parts = re.split(r"^\$ ", example.parsed, flags=re.MULTILINE)[1:]
    assert parts, "a console block begins its commands with '$ '"
    for part in parts:
        command, _, shown = part.partition("\n")
        if command.startswith("rig "):
            run_rig(command, shown, example.namespace["_capsys"])
        else:
            check_shell_line(command)


def run_rig(command: str, shown: str, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = [QUICK.get(word, word) for word in shlex.split(command, comments=True)[1:]]
    capsys.readouterr()
    status = run_command(arguments)
    answer = capsys.readouterr()
    assert status in SOUND, f"{command}: exit status {status}\n{answer.err}"
    if shown.strip().startswith("{"):
        assert missing_keys(json.loads(shown), json.loads(answer.out)) == [], command


def missing_keys(shown: Any, real: Any, place: str = "") -> list[str]:
    """Keys that a page shows and the real answer lacks."""
    if not isinstance(shown, dict):
        return []
    missing = [f"{place}{key}" for key in shown if key not in real]
    inner = [missing_keys(value, real[key], f"{place}{key}.") for key, value in shown.items() if key in real]
    return missing + [name for names in inner for name in names]


def check_shell(example: Example) -> None:
    for line in example.parsed.splitlines():
        check_shell_line(line.split("#")[0].strip())


def check_shell_line(line: str) -> None:
    """Make targets and scripts exist; packages are those that continuous integration installs."""
    words = shlex.split(line)
    if not words:
        return
    if words[0] == "make":
        makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
        assert re.search(rf"^{words[1]}:", makefile, re.MULTILINE), f"no target {words[1]}"
    elif words[:3] == ["sudo", "apt-get", "install"]:
        needed = (ROOT / ".ci" / "run").read_text(encoding="utf-8").split()
        assert [word for word in words[3:] if word not in needed] == []
    elif words[0] in {".venv/bin/python", "python"}:
        script = words[2] if words[1] == "-m" else words[1]
        assert script == "pytest" or (ROOT / script).is_file(), line
    else:
        assert words[0] in {"git", "cd", "source"}, f"how is {line!r} to be checked?"


def check_toml(example: Example) -> None:
    """A whole file has to be valid as it stands; a part of one, laid over the last whole one (or `ci-tiny`)."""
    data = tomllib.loads(example.parsed)
    tiny = ROOT / "hw_profiles" / "ci-tiny.toml"
    base = example.namespace.get("_whole") or tomllib.loads(tiny.read_text(encoding="utf-8"))
    if set(data) == {"scale"}:  # its pixels are a usual projector's, of which the tiny one has a quarter
        base = overlaid(base, {"projector": {"width_px": 1920, "height_px": 1080}})
    whole = data if "schema" in data else overlaid(base, data)
    if "schema" in data:
        example.namespace["_whole"] = data
    if "subject" in whole:
        check_study(example.parsed)
    elif "board" in whole:
        Path("lenses.toml").write_text(toml_of(whole), encoding="utf-8")
        load_lens_manifest(Path("lenses.toml"))
    elif "show" in whole:
        request_of(whole)
    elif isinstance(whole["projector"], list):
        Profile.parse(toml_of(whole).encode(), ROOT / "hw_profiles" / "page.toml")
    else:
        Path("page.toml").write_text(toml_of(whole), encoding="utf-8")
        load_manifest(Path("page.toml"))


def check_study(text: str) -> None:
    """Each point has inputs that its subject knows."""
    Path("study.toml").write_text(text, encoding="utf-8")
    study = read_study(Path("study.toml"))
    subject = subject_of(study.subject)
    base = subject.base_of(study.base, Path())
    assert [subject.complete(settings, base) for settings in settings_of(study)]


def overlaid(base: dict[str, Any], part: dict[str, Any]) -> dict[str, Any]:
    """The base with a part's keys, camera by camera; [[scale]] and [replay] are replaced as a whole."""
    result = dict(base)
    for key, value in part.items():
        own = result.get(key)
        if key in {"scale", "replay"} or own is None:
            result[key] = value
        elif isinstance(own, list) and key in {"camera", "projector"}:
            result[key] = [overlaid(one, value if isinstance(value, dict) else value[0]) for one in own]
        else:
            result[key] = overlaid(own, value) if isinstance(value, dict) and isinstance(own, dict) else value
    if any(one.get("driver") == "replay" for one in result.get("camera", ()) if isinstance(one, dict)):
        result.pop("simulation", None)
    return result


def toml_of(table: dict[str, Any], prefix: str = "") -> str:
    """TOML of nested tables; enough for profiles and manifests."""
    lines = [f"{key} = {toml_value(value)}" for key, value in table.items() if not (is_table(value) or is_array(value))]
    for key, value in table.items():
        if is_table(value):
            lines += [f"[{prefix}{key}]", toml_of(value, f"{prefix}{key}.")]
        for one in value if is_array(value) else ():
            lines += [f"[[{prefix}{key}]]", toml_of(one, f"{prefix}{key}.")]
    return "\n".join(lines)


def is_table(value: Any) -> bool:
    return isinstance(value, dict)


def is_array(value: Any) -> bool:
    """An array of tables."""
    return isinstance(value, list) and bool(value) and all(map(is_table, value))


def toml_value(value: Any) -> str:
    if isinstance(value, list):
        return "[" + ", ".join(map(toml_value, value)) + "]"
    return json.dumps(value) if isinstance(value, bool | str) else repr(value)


def test_the_long_run_code_is_misread_far_less_often_as_its_page_says() -> None:
    benchmark = runpy.run_path(str(ROOT / "benchmarks" / "calibration" / "gray_codes.py"))
    with open_rig("ci-tiny") as rig:
        benchmark["expose"](rig)
        wrong = {code: benchmark["read_code"](rig, code).wrong_share for code in ("gray", "long-run")}
    assert wrong["gray"] > 0.02
    assert wrong["long-run"] < 0.1 * wrong["gray"]
