"""Records become JSON and come back; a verdict holds a number against its limit."""

import importlib
import json
import pkgutil
from collections.abc import Iterator
from dataclasses import MISSING, dataclass, fields
from pathlib import Path

import numpy as np
import pytest

import rig
from rig.records import Record, Verdict, all_met, json_of, read_record


@dataclass(frozen=True, kw_only=True)
class Lens(Record):
    focal_px: tuple[float, float]
    name: str | None = None


@dataclass(frozen=True, kw_only=True)
class Calibration(Record):
    lenses: dict[str, Lens]
    rms_px: float


CALIBRATION = Calibration(lenses={"camera": Lens(focal_px=(900.0, 901.5))}, rms_px=0.12)


def test_a_record_goes_through_json_unchanged() -> None:
    assert read_record(Calibration, json.loads(json.dumps(CALIBRATION.as_json()))) == CALIBRATION


def test_what_is_not_there_is_left_out() -> None:
    assert CALIBRATION.as_json() == {"lenses": {"camera": {"focal_px": [900.0, 901.5]}}, "rms_px": 0.12}


def kinds_below(kind: type[Record]) -> Iterator[type[Record]]:
    for each in kind.__subclasses__():
        yield each
        yield from kinds_below(each)


def test_what_a_record_leaves_out_can_be_left_out_when_it_is_read() -> None:
    """Of all kinds: a field that may be None is not in the JSON then, so that it needs None as its default."""
    for module in pkgutil.walk_packages(rig.__path__, "rig."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)
    unreadable = [
        f"{kind.__module__}.{kind.__name__}.{field.name}"
        for kind in set(kinds_below(Record))
        for field in (fields(kind) if kind.__module__.startswith("rig.") and kind.as_json is Record.as_json else ())
        if str(field.type).endswith("| None") and field.default is MISSING and field.default_factory is MISSING
    ]
    assert not unreadable


def test_numpy_numbers_arrays_and_paths_become_plain() -> None:
    given = {"a": np.float64(0.5), "b": np.arange(3), "c": Path("x") / "y", "d": (np.bool_(True),)}
    assert json_of(given) == {"a": 0.5, "b": [0, 1, 2], "c": "x/y", "d": [True]}


def test_what_json_cannot_say_is_refused_by_its_type() -> None:
    with pytest.raises(TypeError, match="complex has no form in JSON"):
        json_of({"a": 1j})


def test_a_record_that_lacks_a_field_is_refused_by_name() -> None:
    with pytest.raises(ValueError, match="rms_px"):
        read_record(Calibration, {"lenses": {}})


@pytest.mark.parametrize(
    ("value", "at_least", "met", "status"),
    [
        (1.0, False, True, "ok"),
        (1.1, False, False, "OUTSIDE"),
        (1.0, True, True, "ok"),
        (0.9, True, False, "OUTSIDE"),
        (float("nan"), False, False, "OUTSIDE"),
        (None, False, True, "not measured"),
    ],
)
def test_a_verdict_holds_a_value_against_its_limit(value: float | None, at_least: bool, met: bool, status: str) -> None:
    verdict = Verdict(what="rms", value=value, limit=1.0, at_least=at_least)
    assert (verdict.met, verdict.status) == (met, status)
    assert all_met((verdict,)) is met


def test_a_number_without_a_limit_is_only_told() -> None:
    assert Verdict(what="baseline", value=0.6, unit="m").status == "info"
