"""A session that cannot go on leaves a page: where it stopped, why, and what was photographed by then."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

PROFILE = Path(__file__).parents[3] / "hw_profiles" / "ci-tiny.toml"


@pytest.fixture(scope="module")
def stopped(tmp_path_factory: pytest.TempPathFactory) -> tuple[subprocess.CompletedProcess[str], Path]:
    """A session whose tape says that the room is a metre higher than it is."""
    folder = tmp_path_factory.mktemp("stopped")
    wrong = PROFILE.read_text(encoding="utf-8").replace("size_m = [4.80, 4.80, 2.40]", "size_m = [4.80, 4.80, 3.40]")
    (folder / "wrong-tape.toml").write_text(wrong, encoding="utf-8")
    command = [sys.executable, "-m", "rig", "run", str(folder / "session"), "-p", str(folder / "wrong-tape.toml")]
    return subprocess.run(command, capture_output=True, text=True, check=False), folder / "session"


@pytest.mark.slow
def test_the_last_lines_say_why_it_stopped_and_where_the_page_is(
    stopped: tuple[subprocess.CompletedProcess[str], Path],
) -> None:
    run, session = stopped
    reason, page = run.stderr.strip().splitlines()[-2:]
    assert run.returncode == 1
    assert "3.400 +- 0.010 m by [surface] size_m" in reason
    assert page.endswith(str(session / "report.html"))


@pytest.mark.slow
def test_the_page_shows_the_reason_each_step_and_what_was_photographed(
    stopped: tuple[subprocess.CompletedProcess[str], Path],
) -> None:
    page = (stopped[1] / "report.html").read_text(encoding="utf-8")
    assert "sigma apart, the limit is 4" in page
    assert re.findall(r"<td>(\w+)</td><td>(done|stopped here|not begun)</td>", page) == [
        ("exposure", "done"),
        ("response", "done"),
        ("gray", "done"),
        ("correspondence", "done"),
        ("geometry", "stopped here"),
        ("separation", "not begun"),
        ("model", "not begun"),
        ("compensate", "not begun"),
        ("project", "not begun"),
        ("compare", "not begun"),
    ]
    assert "gray: white" in page
    assert "Projector column" in page
