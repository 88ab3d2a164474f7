"""Outputs of real kernel drivers: what is plugged in, shown and read back, also by other programs."""

import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from rig.devices.clock import SystemClock
from rig.devices.kms.find import choose_output, list_outputs
from rig.devices.kms.projector import KmsProjector
from rig.devices.kms.readback import Readback
from rig.devices.protocols import Codes
from rig.errors import DeviceError

SHAPE = (480, 640)
CLOCK = SystemClock()


def make(output: str, shape: tuple[int, int] = SHAPE, refresh_rate_hz: float = 60.0) -> KmsProjector:
    return KmsProjector(output, shape=shape, refresh_rate_hz=refresh_rate_hz, clock=CLOCK)


@contextmanager
def opened(device: KmsProjector | Readback) -> Iterator:
    device.open()
    try:
        yield device
    finally:
        device.close()


def noise(seed: int, shape: tuple[int, ...] = SHAPE) -> Codes:
    return np.random.default_rng(seed).integers(0, 256, shape).astype(np.uint8)


def as_colour(codes: Codes) -> Codes:
    return codes if codes.ndim == 3 else codes[..., None].repeat(3, axis=2)


def read_back(output: str) -> Codes:
    with opened(Readback(output)) as readback:
        return readback.picture()


def plug(output: str, state: str) -> None:
    (choose_output(output, list_outputs()).folder / "status").write_text(state)


class Child:
    """A program of its own that runs a function; what the function says can be read."""

    def __init__(self, function: Callable[[Callable[[str], None]], None]):
        reading, writing = os.pipe()
        self.pid = os.fork()
        if self.pid == 0:
            try:
                function(lambda text: os.write(writing, text.encode()) and None)
            except DeviceError as error:
                os.write(writing, f"{type(error).__name__}: {error}".encode())
            finally:
                os._exit(0)
        os.close(writing)
        self._reading = reading

    def said(self) -> str:
        return os.read(self._reading, 4096).decode()

    def end(self, number: int = signal.SIGKILL) -> None:
        os.kill(self.pid, number)
        os.waitpid(self.pid, 0)
        os.close(self._reading)


@contextmanager
def child(function: Callable[[Callable[[str], None]], None]) -> Iterator[Child]:
    started = Child(function)
    try:
        yield started
    finally:
        started.end()


def show_white_forever(output: str) -> Callable[[Callable[[str], None]], None]:
    def run(say: Callable[[str], None]) -> None:
        projector = make(output)
        projector.open()
        projector.show(np.full(SHAPE, 255, np.uint8), name="white")
        say("shown")
        signal.pause()

    return run


def show_many(projector: KmsProjector, count: int) -> None:
    for number in range(count):
        projector.show(noise(number % 2), name="noise")


def fail_while_white_is_shown(projector: KmsProjector) -> None:
    with opened(projector):
        projector.show(np.full(SHAPE, 255, np.uint8), name="white")
        raise ZeroDivisionError


def interrupted(until_s: float) -> None:
    raise KeyboardInterrupt


@contextmanager
def checksums(output: str) -> Iterator[Callable[[], dict[int, str]]]:
    """Checksums of the frames that a vkms output has sent, by the number of their refresh."""
    number = output.split(":")[0].removeprefix("card")
    folder = Path(f"/sys/kernel/debug/dri/{number}/crtc-0/crc")
    (folder / "control").write_text("auto")
    data = os.open(folder / "data", os.O_RDONLY | os.O_NONBLOCK)
    seen: dict[int, str] = {}

    def read() -> dict[int, str]:
        while True:
            try:
                lines = os.read(data, 4096).decode().replace("\0", "").splitlines()
            except BlockingIOError:
                return seen
            seen.update((int(line.split()[0], 16), line.split()[1]) for line in lines if line)

    try:
        yield read
    finally:
        os.close(data)
