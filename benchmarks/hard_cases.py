"""The figures of docs/explanation/hard-cases.md, as the tests measure them: python benchmarks/hard_cases.py."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

TESTS = Path(__file__).parents[1] / "tests" / "sim" / "hard_cases"


class Figures:
    """Gathers what the tests record."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.when != "call":
            return
        name = report.nodeid.partition("::")[2]
        figures = "; ".join(f"{what}: {value}" for what, value in report.user_properties)
        self.lines.append(f"{report.outcome:8} {name}  {figures}")


def main() -> int:
    """Run the hard cases and print their figures."""
    figures = Figures()
    status = pytest.main([str(TESTS), "-q", "--no-header", "-p", "no:cacheprovider"], plugins=[figures])
    print("\n".join(figures.lines))
    return int(status)


if __name__ == "__main__":
    sys.exit(main())
