"""What tests of a whole session share: one of the smallest rig, made once, and a browser."""

import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from tests.made_once import made_once

CHROMIUM = next((path for name in ("chromium", "chromium-browser") if (path := shutil.which(name))), None)


@dataclass(frozen=True)
class Finished:
    """An undisturbed `rig run`; tests only read it, or copy it."""

    folder: Path
    out: str
    err: str


@pytest.fixture(scope="session")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Finished:
    made = made_once(tmp_path_factory, "undisturbed", _run)
    return Finished(made / "session", (made / "out").read_text("utf-8"), (made / "err").read_text("utf-8"))


@pytest.fixture(scope="module", autouse=True)
def _only_read(request: pytest.FixtureRequest) -> Iterator[None]:
    """What a module writes into the shared session, another worker may be copying at that moment."""
    tests = [item for item in request.session.items if item.path == request.path]
    if not any("finished" in getattr(item, "fixturenames", ()) for item in tests):
        yield
        return
    folder = request.getfixturevalue("finished").folder
    before = _stamps(folder)
    yield
    changed = before ^ _stamps(folder)
    assert not changed, f"this module, or one beside it, wrote into the session that all share: {sorted(changed)}"


def _stamps(folder: Path) -> set[tuple[str, int]]:
    return {(str(path.relative_to(folder)), path.stat().st_mtime_ns) for path in folder.rglob("*")}


def _run(folder: Path) -> None:
    command = [sys.executable, "-m", "rig", "run", str(folder / "session"), "-p", "ci-tiny", "--json"]
    run = subprocess.run(command, capture_output=True, encoding="utf-8", check=False)
    assert run.returncode in (0, 1), run.stderr
    (folder / "out").write_text(run.stdout, encoding="utf-8")
    (folder / "err").write_text(run.stderr, encoding="utf-8")


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    """A browser. It goes with its module: while Playwright runs, no other test of its process has an event loop."""
    if CHROMIUM is None:
        pytest.skip("no chromium on this machine: the page is not driven in a browser")
    sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    with sync_api.sync_playwright() as playwright:
        options = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=options)
        yield browser
        browser.close()
