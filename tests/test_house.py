"""House rules as tests: who may know whom, how long things may be, and what never stands in a file."""

import ast
import os
import shutil
import statistics
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("rig", "sim", "calibration")
LONGEST_FUNCTION, MEDIAN_FUNCTION = 80, 10
LONGEST_FILE, LONG_FILE = 600, 400
LONG_FILES: dict[str, str] = {}
"""Files above 400 lines, and why each may be so."""
FORBIDDEN = ("/wo" + "rk/", "/ro" + "ot/", "/ho" + "me/")
LINT = """
import sys
sys.meta_path[:] = [f for f in sys.meta_path if "Redirecting" not in type(f).__name__]
sys.path.insert(0, ".")
from importlinter.cli import lint_imports
sys.exit(lint_imports(cache_dir=None, no_cache=True))
"""
"""import-linter on the packages of the current folder; without the finder of an editable install, which would
lead back to the real ones."""


def sources() -> list[Path]:
    return [path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))]


def functions(path: Path) -> Iterator[tuple[str, int]]:
    """(name, lines of its body without the docstring) of each function."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            body = node.body[1:] if ast.get_docstring(node) is not None else node.body
            yield node.name, body[-1].end_lineno - body[0].lineno + 1 if body else 0


def test_no_function_is_longer_than_a_screen_and_half_are_short() -> None:
    lengths = {f"{path.name}:{name}": length for path in sources() for name, length in functions(path)}
    assert {name: length for name, length in lengths.items() if length > LONGEST_FUNCTION} == {}
    assert statistics.median(lengths.values()) < MEDIAN_FUNCTION


def test_files_stay_short_or_say_why_not() -> None:
    lines = {path.relative_to(ROOT).as_posix(): len(path.read_text("utf-8").splitlines()) for path in sources()}
    assert {name: n for name, n in lines.items() if n >= LONGEST_FILE} == {}
    assert {name: n for name, n in lines.items() if n > LONG_FILE and name not in LONG_FILES} == {}


def test_no_file_names_a_folder_of_somebodys_machine() -> None:
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    if listed.returncode != 0:
        pytest.skip("not a git checkout")
    texts = {name: _text(ROOT / name) for name in listed.stdout.split()}
    assert [(name, word) for name, text in texts.items() for word in FORBIDDEN if word in text] == []


def _text(path: Path) -> str:
    return path.read_bytes().decode("utf-8", errors="replace") if path.is_file() else ""


def lint_imports(folder: Path) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1", "COLUMNS": "120"}
    return subprocess.run(
        [sys.executable, "-c", LINT], cwd=folder, capture_output=True, text=True, check=False, env=environment
    )


@pytest.fixture
def copied_tree(tmp_path: Path) -> Path:
    """The three packages and the contracts, without what git ignores."""
    for package in PACKAGES:
        shutil.copytree(ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__", "*.so"))
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    return tmp_path


def test_the_layers_are_kept(copied_tree: Path) -> None:
    result = lint_imports(copied_tree)
    assert result.returncode == 0, result.stdout + result.stderr


@pytest.mark.parametrize(
    ("file", "line"),
    [
        ("sim/geometry/scene.py", "import rig.errors"),
        ("sim/geometry/scene.py", "import calibration.records"),
        ("calibration/structured_light/decode.py", "import sim.errors"),
        ("calibration/structured_light/decode.py", "import os"),
        ("rig/devices/clock.py", "import rig.capture.rig"),
        ("rig/stages/target.py", "import rig.run.session"),
        ("rig/files/atomic.py", "import rig.profile.schema"),
        ("rig/truth/scores.py", "import rig.report.page"),
        ("sim/geometry/surface.py", "import sim.light.radiosity"),
    ],
)
def test_a_planted_wrong_import_is_found(copied_tree: Path, file: str, line: str) -> None:
    planted = copied_tree / file
    planted.write_text(planted.read_text(encoding="utf-8") + f"\n{line}\n", encoding="utf-8")
    result = lint_imports(copied_tree)
    assert result.returncode != 0
    assert "BROKEN" in result.stdout
    assert line.split()[1].split(".")[0] in result.stdout
