"""Ctrl-C ends long computations in real processes, whatever loop of the kernel they are in."""

import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "benchmarks" / "interrupts.py"
MOST_S = "5"
"""Of processor time, ten times what is promised."""


@pytest.mark.parametrize("job", ["closed form", "exact occlusion", "pictures", "trees", "plan and solution"])
def test_a_computation_at_work_ends_soon_after_an_interrupt(job):
    done = subprocess.run([sys.executable, str(SCRIPT), "1", MOST_S, job], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_simplification_ends_soon_after_an_interrupt():
    pytest.importorskip("fast_simplification")
    done = subprocess.run(
        [sys.executable, str(SCRIPT), "1", MOST_S, "simplification"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
