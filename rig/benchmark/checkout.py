"""Files that only a checkout of the sources has: stored reference data and the scripts that made them."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).parents[2]


def data_file(name: str) -> Path | None:
    """A file of tests/data; none where the product was installed without its sources."""
    path = ROOT / "tests" / "data" / name
    return path if path.is_file() else None


def script(name: str) -> ModuleType | None:
    """A script of benchmarks/ as a module; none where the product was installed without its sources."""
    path = ROOT / "benchmarks" / f"{name}.py"
    spec = importlib.util.spec_from_file_location(f"benchmarks_{name}", path) if path.is_file() else None
    if spec is None or spec.loader is None:
        return None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
