"""The closed loop on real drivers: a KMS display, the simulated room, a USB camera under uvcvideo."""

from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

from rig.capture.rig import Rig, open_rig
from rig.devices.protocols import Codes
from tests.contract.lab import emulated_rig, open_emulated

BITS = 9
COLUMNS, ROWS = 3, 3
PATTERNS = 500


def coded(shape: tuple[int, int], number: int) -> Codes:
    """A picture of three by three fields: a number's bits, white for 1."""
    bits = np.array([[number >> (row * COLUMNS + column) & 1 for column in range(COLUMNS)] for row in range(ROWS)])
    fine = np.kron(bits, np.ones((-(-shape[0] // ROWS), -(-shape[1] // COLUMNS))))
    return np.asarray(255 * fine[: shape[0], : shape[1]], dtype=np.uint8)


class Reader:
    """Reads a number from a photograph of its picture, by photographs of each bit alone."""

    def __init__(self, rig: Rig):
        self._black = self._shoot(rig, 0)
        lit = [self._shoot(rig, 1 << bit) - self._black for bit in range(BITS)]
        brightest = np.argmax(lit, axis=0)
        strong = np.max(lit, axis=0)
        self._fields = [(brightest == bit) & (strong > 0.6 * lit[bit].max()) for bit in range(BITS)]
        self._light = np.array([[one[field].mean() for one in lit] for field in self._fields])

    @staticmethod
    def _shoot(rig: Rig, number: int) -> NDArray[np.float64]:
        return rig.shoot(coded(rig.projector.shape, number), name=f"number-{number}").pixels[..., 0].astype(float)

    def read(self, pixels: NDArray[np.uint16]) -> int:
        """The number; every field is lit by every other one, too, so the bits are what explains all fields."""
        light = pixels[..., 0] - self._black
        bits = np.linalg.solve(self._light, [light[field].mean() for field in self._fields])
        assert np.abs(bits - np.rint(bits)).max() < 0.3, bits
        return sum(1 << bit for bit, value in enumerate(np.rint(bits)) if value > 0)


@pytest.fixture(scope="module")
def rig() -> Iterator[Rig]:
    with open_emulated() as rig:
        rig.set_exposure(0.008)
        yield rig


@pytest.fixture(scope="module")
def reader(rig: Rig) -> Reader:
    return Reader(rig)


def test_each_of_500_frames_shows_its_own_pattern(rig: Rig, reader: Reader) -> None:
    numbers = np.random.default_rng(500).permutation(1 << BITS)[:PATTERNS]
    read = []
    for number in numbers:
        frame = rig.shoot(coded(rig.projector.shape, int(number)), name=f"number-{number}")
        read.append(reader.read(frame.pixels))
    assert read == numbers.tolist()


def test_frames_that_are_lost_repeated_broken_or_cut_are_never_taken_for_another(rig: Rig, reader: Reader) -> None:
    faults, random = emulated_rig().faults, np.random.default_rng(3)
    before = len(rig.events)
    for number in random.permutation(1 << BITS)[:40]:
        fault = random.choice(["dropped_frames", "duplicate_frames", "error_frames", "short_frames"])
        setattr(faults, fault, 5)  # three pass while the picture settles
        frame = rig.shoot(coded(rig.projector.shape, int(number)), name=f"number-{number}")
        assert reader.read(frame.pixels) == number, fault
    assert {"repeated"} <= {event.kind for event in rig.events[before:]}


def test_a_rig_that_was_closed_is_opened_again(rig: Rig, reader: Reader) -> None:
    rig.close()
    with open_rig(rig.profile) as again:
        again.set_exposure(0.008)
        assert reader.read(again.shoot(coded(again.projector.shape, 137), name="number-137").pixels) == 137
