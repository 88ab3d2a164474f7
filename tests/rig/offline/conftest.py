"""Photographs of a simulated relief whose projector stands above the camera, and what a scan makes of them."""

import runpy
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

BENCHMARKS = Path(__file__).parents[3] / "benchmarks" / "calibration"


@pytest.fixture(scope="module")
def bench() -> Iterator[SimpleNamespace]:
    with pytest.MonkeyPatch.context() as patched:
        patched.syspath_prepend(BENCHMARKS)
        yield SimpleNamespace(**runpy.run_path(str(BENCHMARKS / "wrong_photographs.py")))


@pytest.fixture(scope="module")
def relief(bench: SimpleNamespace) -> Any:
    return bench.vertical_set()
