"""A GigE Vision camera on loopback: Aravis' fake camera, whose pictures are made here.

Any GenICam program can open it. It has the features of :mod:`rig.emulated.gige.description`, and honours exposure,
gain, black level, gamma and pixel format.
"""

from __future__ import annotations

import ctypes
import socket
import tempfile
import traceback
from collections.abc import Callable
from ctypes import CFUNCTYPE, byref, c_size_t, c_uint32, c_void_p
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rig.devices.genicam.aravis import aravis
from rig.devices.genicam.find import CONTROL_PORT
from rig.devices.genicam.formats import PIXEL_FORMATS
from rig.emulated.gige import description as registers
from rig.emulated.gige.description import EmulatedSensor, description
from rig.emulated.gige.wire import Feeder, PulseWire
from rig.errors import DeviceError

ADDRESS = "127.0.0.1"
"""Of an emulated camera, unless another of the loopback network is given."""
_NAME_OF_CODE = {one.code: one.name for one in PIXEL_FORMATS.values()}
_TRIGGERS_HZ = 100.0
"""How often Aravis looks for a trigger; 25 unless told, and faster it spends much of a core: it waits by asking."""
_FILL = CFUNCTYPE(None, *(c_void_p, c_void_p, c_uint32, c_uint32, c_uint32))


@dataclass(frozen=True, slots=True, kw_only=True)
class GigeRequest:
    """One exposure, as the program that drives the camera has set it."""

    exposure_s: float
    gain: float
    """Factor."""
    black_level_dn: float
    """On top of the sensor's own, in steps of 8 bits."""
    gamma: float
    pixel_format: str
    shape: tuple[int, int]


class GigeView(Protocol):
    """What the camera looks at."""

    def expose(self, request: GigeRequest) -> bytes:
        """Look for the length of an exposure, and return a picture of the format; late by what it takes."""
        ...


@dataclass(slots=True)
class GigeFaults:
    """What may go wrong; changed while the camera runs."""

    lost_packets: float = 0.0
    """Share of the packets of pictures that never arrive."""
    jitter_s: float = 0.0
    """Longest delay of a picture, drawn anew for each."""
    wire_is_cut: bool = False
    """Whether no pulse comes over the wire."""
    random: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))


class EmulatedGigeCamera:
    """A camera that is on the network between :meth:`plug` and :meth:`unplug`; in a ``with`` statement, throughout.

    Parameters
    ----------
    view
        What it looks at.
    sensor
        What it says of itself.
    serial
        By which programs find it.
    address
        Of loopback.
    wait
        Lets the picture come later, for jitter: seconds.
    wire
        What gives pulses on Line0; None: nothing is connected.
    note
        Called with what went wrong while a picture was made.
    """

    def __init__(
        self,
        view: GigeView,
        sensor: EmulatedSensor,
        *,
        serial: str = "EMULATED1",
        address: str = ADDRESS,
        wait: Callable[[float], None],
        wire: PulseWire | None = None,
        note: Callable[[str], None] = print,
    ):
        self.faults = GigeFaults()
        self.address, self.serial = address, serial
        self.frames = 0
        """That were made so far."""
        self._view, self._sensor, self._wait, self._note = view, sensor, wait, note
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        self._server: int | None = None
        self._fake: int | None = None
        self._fill = _FILL(self._fill_buffer)
        self._is_armed = False
        self._wire, self._feeder = wire, None if wire is None else Feeder(wire.rate_hz, self._arm)

    def plug(self) -> None:
        """Bring it to the network; no-op while it is there. Raises DeviceError."""
        if self._server is not None:
            return
        self._refuse_taken_address()
        self._folder = tempfile.TemporaryDirectory()
        path = Path(self._folder.name) / "camera.xml"
        path.write_text(description(self._sensor), "utf-8")
        library = aravis()
        server = library.call("arv_gv_fake_camera_new_full", *map(str.encode, (self.address, self.serial, str(path))))
        if not server or not library.call("arv_gv_fake_camera_is_running", server):
            if server:
                library.call("g_object_unref", server)
            self.unplug()
            raise DeviceError(
                f"no camera could be put on {self.address}: Aravis does not serve there; "
                "name an address that a network card of this machine has (`ip address`)"
            )
        self._server, self._fake = server, library.call("arv_gv_fake_camera_get_fake_camera", server)
        self._set_up()
        if self._feeder is not None:
            self._feeder.start()

    def _refuse_taken_address(self) -> None:
        """Raise DeviceError where a camera is served already: the library would let two answer in turn."""
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.bind((self.address, CONTROL_PORT))
            except OSError as error:
                raise DeviceError(
                    f"no camera could be put on {self.address} ({error.strerror}): another emulated camera is there: "
                    "end it; or no network card of this machine has that address (`ip address`)"
                ) from error

    def _set_up(self) -> None:
        for register, value in (
            (registers.WIDTH, self._sensor.width_px),
            (registers.HEIGHT, self._sensor.height_px),
            (registers.SENSOR_WIDTH, self._sensor.width_px),
            (registers.SENSOR_HEIGHT, self._sensor.height_px),
            (registers.PIXEL_FORMAT, PIXEL_FORMATS[self._sensor.formats[0]].code),
            (registers.GAIN, 0),
            (registers.BLACK, 0),
            (registers.GAMMA, registers.GAMMA_STEPS),
            (registers.TRIGGERED_BY, registers.SOFTWARE),
            (registers.TRIGGER_SOURCE, registers.SOFTWARE),
            *((address, registers.AUTO_ENTRIES["Continuous"]) for address in registers.AUTOMATICS.values()),
        ):
            self.write_register(register, value)
        aravis().call("arv_fake_camera_set_trigger_frequency", self._fake, _TRIGGERS_HZ)
        aravis().call("arv_fake_camera_set_fill_pattern", self._fake, ctypes.cast(self._fill, c_void_p), None)
        self.lose_packets(self.faults.lost_packets)

    def lose_packets(self, share: float) -> None:
        """Lose so many of the packets of pictures from now on, at random."""
        self.faults.lost_packets = share
        if self._server is not None:
            aravis().set_properties(self._server, gvsp_lost_ratio=float(share))

    def forget_heartbeat(self) -> None:
        """Behave as after the heartbeats of the program that controls it did not arrive: nobody controls it."""
        self.write_register(0x0A00, 0)

    def unplug(self) -> None:
        """Pull the cable; any number of times."""
        if self._feeder is not None:
            self._feeder.stop()
        server, self._server = self._server, None
        if server is not None:
            aravis().call("g_object_unref", server)  # waits for a picture that is being made, which still looks here
        self._fake = None
        if self._folder is not None:
            self._folder.cleanup()
            self._folder = None

    def __enter__(self) -> EmulatedGigeCamera:
        self.plug()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.unplug()

    @property
    def frame_rate_hz(self) -> float:
        """At which it would run freely."""
        return 1e6 / self.read_register(registers.PERIOD_US)

    @property
    def _is_wired(self) -> bool:
        """Whether exposures begin with the pulses of the wire."""
        read = self.read_register
        return read(registers.TRIGGER_MODE) == 1 and read(registers.TRIGGER_SOURCE) == registers.LINE

    def _arm(self) -> None:
        """Let Aravis ask for a picture, which then waits for its pulse; a pulse during an exposure is lost so."""
        is_live = self._is_wired and not self.faults.wire_is_cut
        if is_live or self._is_armed:
            self.write_register(registers.TRIGGER, int(is_live))
        self._is_armed = is_live

    def write_register(self, register: int, value: int) -> None:
        """Change a register of :mod:`rig.emulated.gige.description`, as another program might."""
        aravis().call("arv_fake_camera_write_register", self._fake, register, value)

    def read_register(self, register: int) -> int:
        """Return what a register holds."""
        value = c_uint32()
        aravis().call("arv_fake_camera_read_register", self._fake, register, byref(value))
        return value.value

    def _fill_buffer(self, buffer: int, _data: int, exposure_us: int, gain: int, pixel_format: int) -> None:
        """Make a picture; called by Aravis' thread, out of which no exception may come."""
        try:
            request = GigeRequest(
                exposure_s=exposure_us * 1e-6,
                gain=10 ** (gain / registers.GAIN_STEPS / 20),
                black_level_dn=float(self.read_register(registers.BLACK)),
                gamma=self.read_register(registers.GAMMA) / registers.GAMMA_STEPS,
                pixel_format=_NAME_OF_CODE.get(pixel_format, "Mono8"),
                shape=(self.read_register(registers.HEIGHT), self.read_register(registers.WIDTH)),
            )
            if self._wire is not None and self._is_wired:
                self._wire.wait_for_pulse()
            data = self._view.expose(request)
            self.frames += 1
            if self.faults.jitter_s:
                self._wait(float(self.faults.random.uniform(0, self.faults.jitter_s)))
            target = aravis().call("arv_buffer_get_data", buffer, byref(c_size_t()))
            room = PIXEL_FORMATS[request.pixel_format].least_bytes(request.shape[1], request.shape[0])
            ctypes.memmove(target, data, min(len(data), room))  # Aravis has made it as large as the features say
        except BaseException:  # noqa: BLE001 - there is nobody above to take it
            self._note(traceback.format_exc())


def encoded(pixels: NDArray[np.uint16], name: str) -> bytes:
    """Return the bytes of a picture (H, W, numbers) in a pixel format; numbers have its depth already."""
    numbers, kind = pixels.reshape(-1), PIXEL_FORMATS[name]
    if kind.bits_per_pixel == 8 * kind.numbers:
        return numbers.astype(np.uint8).tobytes()
    if kind.bits_per_pixel == 16:
        return numbers.astype("<u2").tobytes()
    return _in_bits(numbers, kind.depth, name.endswith("Packed"))


def _in_bits(numbers: NDArray[np.uint16], depth: int, is_packed: bool) -> bytes:
    """Bit by bit, as the conventions draw it: slow, and independent of what reads it."""
    padded = np.concatenate([numbers, np.zeros(-len(numbers) % 4, np.uint16)])
    bits = (padded[:, None] >> np.arange(depth)) & 1
    if is_packed:
        low, pairs = depth - 8, bits.reshape(-1, 2, depth)
        rows = np.zeros((len(pairs), 24), np.uint8)
        rows[:, :8], rows[:, 16:] = pairs[:, 0, low:], pairs[:, 1, low:]
        rows[:, 8 : 8 + low], rows[:, 12 : 12 + low] = pairs[:, 0, :low], pairs[:, 1, :low]
        return np.packbits(rows.reshape(-1), bitorder="little").tobytes()
    return np.packbits(bits.reshape(-1).astype(np.uint8), bitorder="little").tobytes()
