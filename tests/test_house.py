"""House rules as tests: who may know whom, how long things may be, and what never stands in a file."""

import ast
import os
import shutil
import statistics
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("rig", "sim", "calibration")
LONGEST_FUNCTION, MEDIAN_FUNCTION = 80, 10
LONGEST_FILE = 400
MOST_FILES_IN_A_FOLDER = 16
MOST_POSITIONAL = 4
"""Arguments of a call without their names; more cannot be told apart where the call is read."""
MOST_UNNAMED_FIELDS = 4
"""Of a record that may be made without naming its fields."""
MOST_LOOSE_OBJECTS = 25
"""Places in rig/ where a JSON or TOML object has no type of its own: where such files are read or written."""
ANY_NUMBER = ("print", "pack", "pack_into", "TypeVar")
"""Functions that take as many values as there are."""
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


def kernel_sources() -> list[Path]:
    folders = (ROOT / "native", ROOT / "sim" / "kernel", ROOT / "calibration" / "kernel")
    return sorted(path for folder in folders for path in folder.rglob("*.?pp"))


def name_of(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


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


def test_files_stay_short() -> None:
    lines = {name_of(path): len(path.read_text("utf-8").splitlines()) for path in (*sources(), *kernel_sources())}
    assert {name: n for name, n in lines.items() if n > LONGEST_FILE} == {}


def test_no_folder_holds_more_than_a_glance_takes_in() -> None:
    tests = list((ROOT / "tests").rglob("*.py"))
    counts = Counter(name_of(path.parent) for path in (*sources(), *kernel_sources(), *tests))
    assert {folder: n for folder, n in counts.items() if n > MOST_FILES_IN_A_FOLDER} == {}


def test_no_call_gives_many_arguments_without_their_names() -> None:
    wide = [
        f"{name_of(path)}:{call.lineno} {ast.unparse(call.func)}"
        for path in sources()
        for call in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(call, ast.Call)
        and len(call.args) > MOST_POSITIONAL
        and not any(isinstance(argument, ast.Starred) for argument in call.args)
        and ast.unparse(call.func).split(".")[-1] not in ANY_NUMBER
    ]
    assert wide == []


def test_records_of_many_fields_are_made_by_name() -> None:
    unnamed = [
        f"{name_of(path)}:{record.lineno} {record.name}"
        for path in sources()
        for record in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(record, ast.ClassDef) and len(fields_of(record)) > MOST_UNNAMED_FIELDS and is_unnamed(record)
    ]
    assert unnamed == []


def fields_of(record: ast.ClassDef) -> list[ast.AnnAssign]:
    return [item for item in record.body if isinstance(item, ast.AnnAssign) and "ClassVar" not in ast.unparse(item)]


def is_unnamed(record: ast.ClassDef) -> bool:
    """Whether it can be made from values in a row: a dataclass that does not forbid it, or a NamedTuple."""
    decorators = [ast.unparse(decorator) for decorator in record.decorator_list]
    is_loose_dataclass = any(text.startswith("dataclass") and "kw_only=True" not in text for text in decorators)
    return is_loose_dataclass or any(ast.unparse(base) == "NamedTuple" for base in record.bases)


def test_every_class_has_a_name_of_its_own() -> None:
    places: dict[str, list[str]] = {}
    for path in sources():
        for item in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(item, ast.ClassDef):
                places.setdefault(item.name, []).append(f"{name_of(path)}:{item.lineno}")
    assert {name: found for name, found in places.items() if len(found) > 1} == {}


def test_loose_objects_are_where_json_is_read_or_written_only() -> None:
    counts = {name_of(path): path.read_text("utf-8").count("dict[str, Any]") for path in sources()}
    loose = {name: n for name, n in counts.items() if n and name.startswith("rig/")}
    assert sum(loose.values()) <= MOST_LOOSE_OBJECTS, loose


def runs_while_freed(node: ast.AST) -> bool:
    """Does this make Python run a function while it frees an object?"""
    if isinstance(node, ast.Import):
        return any(name.name == "weakref" for name in node.names)
    if isinstance(node, ast.ImportFrom):
        return node.module == "weakref"
    return isinstance(node, ast.FunctionDef) and node.name == "__del__"


def test_nothing_runs_while_objects_are_freed_for_an_interrupt_that_is_seen_there_is_lost() -> None:
    found = [
        name_of(path) for path in sources() if any(map(runs_while_freed, ast.walk(ast.parse(path.read_text("utf-8")))))
    ]
    assert found == []


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
        ("sim/geometry/scene.py", "import calibration.errors"),
        ("calibration/structured_light/decode.py", "import sim.errors"),
        ("calibration/structured_light/decode.py", "import os"),
        ("rig/devices/clock.py", "import rig.capture.rig"),
        ("rig/stages/target.py", "import rig.run.session"),
        ("rig/files/atomic.py", "import rig.profile.schema"),
        ("rig/truth/scores.py", "import rig.report.page"),
        ("sim/geometry/surface.py", "import sim.light.radiosity"),
        ("calibration/radiometry/mixing.py", "import calibration.structured_light.decode"),
        ("calibration/geometry/pinhole.py", "import calibration.light.separation"),
        ("calibration/lenses/lens.py", "import calibration.geometry.pinhole"),
    ],
)
def test_a_planted_wrong_import_is_found(copied_tree: Path, file: str, line: str) -> None:
    planted = copied_tree / file
    planted.write_text(planted.read_text(encoding="utf-8") + f"\n{line}\n", encoding="utf-8")
    result = lint_imports(copied_tree)
    assert result.returncode != 0
    assert "BROKEN" in result.stdout
    assert line.split()[1].split(".")[0] in result.stdout


@pytest.mark.parametrize(
    ("lines", "complaint"),
    [
        ("from rig.capture.nothing_there import Rig", "import-not-found"),
        ("from rig.capture.rig import nothing_there", "attr-defined"),
        (
            "from rig.capture.rig import Rig\ndef say(rig: Rig) -> None: rig.camera.nothing_there()",
            "attr-defined",
        ),
        ("from rig.capture.rig import open_rig\nopen_rig(nothing_there=1)", "call-arg"),
    ],
)
def test_a_script_that_uses_what_is_gone_from_the_packages_is_found(tmp_path: Path, lines: str, complaint: str) -> None:
    pytest.importorskip("mypy")
    planted = tmp_path / "planted.py"
    planted.write_text(f"import no_such_peer\n{lines}\n", encoding="utf-8")
    checked = subprocess.run(
        [sys.executable, "-m", "mypy", "--config-file", "benchmarks/mypy.ini", str(planted)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert checked.returncode == 1
    assert f"[{complaint}]" in checked.stdout
    assert "no_such_peer" not in checked.stdout
