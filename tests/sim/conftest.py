"""What tests of the native kernel share."""

import pytest

from sim import _kernel
from sim.threads import set_threads


@pytest.fixture
def restored():
    threads, instructions = _kernel.threads(), _kernel.instruction_set()
    yield
    set_threads(threads)
    _kernel.set_instruction_set(instructions)
