"""Stored reference data, and the scripts that made them, which only a checkout of the sources has."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).parents[2]


def data_file(name: str) -> Path:
    """Return the path of a file of reference data."""
    return Path(__file__).parent / "data" / name


def script(name: str) -> ModuleType | None:
    """Return a script of benchmarks/ as a module; None where the product was installed without its sources."""
    path = ROOT / "benchmarks" / f"{name}.py"
    spec = importlib.util.spec_from_file_location(f"benchmarks_{name}", path) if path.is_file() else None
    if spec is None or spec.loader is None:
        return None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
