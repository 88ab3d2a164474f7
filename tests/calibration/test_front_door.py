"""The public names of calibration: that they are few, typed, explained, and that the example in front runs."""

import doctest
import inspect
import re
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path
from types import ModuleType

import pytest

import calibration


def public_functions(package: ModuleType) -> Iterator[tuple[str, object]]:
    """Functions of a package's `__all__`, and the public methods of its classes."""
    for name in package.__all__:
        value = getattr(package, name)
        if inspect.isfunction(value):
            yield name, value
        elif inspect.isclass(value):
            for method, found in vars(value).items():
                function = found.__func__ if isinstance(found, classmethod | staticmethod) else found
                if inspect.isfunction(function) and not method.startswith("_"):
                    yield f"{name}.{method}", function


def parameters(function: object) -> list[str]:
    """Names of what a caller hands over."""
    return [name for name in inspect.signature(function).parameters if name not in ("self", "cls")]  # type: ignore[arg-type]


def explained(function: object, parameter: str) -> bool:
    """Whether the docstring has a line `parameter : kind`, alone or with others."""
    return re.search(rf"^[\w, ]*\b{parameter}\b[\w, ]* : ", inspect.getdoc(function) or "", re.MULTILINE) is not None


def without_sections(package: ModuleType) -> list[str]:
    """Public functions whose docstring lacks the numpydoc section of what they take or of what they return."""
    lacking = []
    for name, function in public_functions(package):
        signature = inspect.signature(function)
        text = inspect.getdoc(function) or ""
        gives = signature.return_annotation not in ("None", None)
        if (parameters(function) and "\nParameters\n---" not in text) or (
            gives and not re.search(r"\n(Returns|Yields)\n---", text)
        ):
            lacking.append(name)
    return lacking


def undescribed(package: ModuleType) -> list[str]:
    """Parameters of public functions that their docstring does not name."""
    return [
        f"{name}: {parameter}"
        for name, function in public_functions(package)
        for parameter in parameters(function)
        if not explained(function, parameter)
    ]


def test_dir_shows_the_public_names_and_nothing_else() -> None:
    assert sorted(dir(calibration)) == sorted(calibration.__all__)
    assert 15 <= len(calibration.__all__) <= 30
    assert all(hasattr(calibration, name) for name in calibration.__all__)


def test_the_version_is_that_of_the_distribution() -> None:
    assert calibration.__version__ == version("procam-rig")


def test_the_package_says_that_it_is_typed() -> None:
    assert (Path(calibration.__file__).parent / "py.typed").is_file()


def test_the_example_in_front_runs() -> None:
    result = doctest.testmod(calibration)
    assert result.attempted > 5
    assert result.failed == 0


def test_every_public_function_says_what_it_takes_and_returns() -> None:
    assert len(list(public_functions(calibration))) > 10
    assert without_sections(calibration) == []
    assert undescribed(calibration) == []


@pytest.mark.parametrize("name", [name for name in calibration.__all__ if not name.startswith("__")])
def test_every_public_name_begins_with_a_sentence(name: str) -> None:
    value = getattr(calibration, name)
    if name == "CODES":
        return
    first = (inspect.getdoc(value) or "").partition("\n\n")[0]
    assert first.endswith(".")
    assert len(first.split()) >= 4
