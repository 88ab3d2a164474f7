"""The emulated LightCrafter as a USB device, for `rig.emulated.usbip.attach`: the kernel's usbhid takes it."""

from __future__ import annotations

import struct
import threading
from collections import deque

from rig.emulated.usbip.device import (
    HOST_READS,
    Descriptors,
    Setup,
    Stall,
    Transfer,
    UsbSpeed,
    configuration_descriptor,
    device_descriptor,
)
from tests.rig.devices.lightcrafter.emulated_controller import REPORT, LightCrafterEmulation

VENDOR_ID, PRODUCT_ID = 0x0451, 0x6401
_HID_DESCRIPTOR, _REPORT_DESCRIPTOR = 0x21, 0x22
_GET_DESCRIPTOR, _SET_IDLE, _SET_REPORT = 0x06, 0x0A, 0x09
_FROM_INTERFACE, _CLASS_TO_INTERFACE = 0x81, 0x21
_REPORTS = bytes.fromhex("0600ff 0901 a101 1500 26ff00 7508 9540 0901 8102 0901 9102 c0")
"""Vendor page; one input and one output report of 64 bytes, without numbers."""
_HID = struct.pack("<BBHBBBH", 9, _HID_DESCRIPTOR, 0x0111, 0, 1, _REPORT_DESCRIPTOR, len(_REPORTS))


def _endpoint(address: int) -> bytes:
    return struct.pack("<BBBBHB", 7, 5, address, 3, REPORT, 1)


class LightCrafterUsb:
    """A :class:`rig.emulated.usbip.device.UsbDevice` around an emulated controller."""

    def __init__(self, controller: LightCrafterEmulation, serial: str = "LCR4500-1"):
        interface = struct.pack("<9B", 9, 4, 0, 0, 2, 3, 0, 0, 0)
        body = interface + _HID + _endpoint(0x81) + _endpoint(0x01)
        self.controller = controller
        self.descriptors = Descriptors(
            device_descriptor(VENDOR_ID, PRODUCT_ID),
            configuration_descriptor(1, body),
            ("Emulated", "DLPC350", serial),
        )
        self.speed = UsbSpeed.FULL
        self._waiting: deque[Transfer] = deque()
        self._kept: bytes | None = None
        self._lock = threading.Lock()

    def plugged(self) -> None:
        """The host has it."""

    def unplugged(self) -> None:
        """The cable is out: forget what the host waited for."""
        with self._lock:
            self._waiting.clear()

    def control(self, setup: Setup, data: bytes) -> bytes:
        """Answer HID's own requests. Raises Stall for others."""
        kind = setup.request_type, setup.request
        if kind == (_FROM_INTERFACE, _GET_DESCRIPTOR):
            found = {_REPORT_DESCRIPTOR: _REPORTS, _HID_DESCRIPTOR: _HID}.get(setup.value >> 8)
            if found is not None:
                return found
        if kind == (_CLASS_TO_INTERFACE, _SET_IDLE):
            return b""
        if kind == (_CLASS_TO_INTERFACE, _SET_REPORT):
            self.controller.receive(data)
            self._pump()
            return b""
        raise Stall

    def select(self, interface: int, alternate: int) -> None:
        """Nothing to choose."""

    def submit(self, transfer: Transfer) -> None:
        """Take a report, or keep the host's question until there is one."""
        if transfer.endpoint & HOST_READS:
            with self._lock:
                self._waiting.append(transfer)
        else:
            self.controller.receive(transfer.data)
            transfer.complete()
        self._pump()

    def _pump(self) -> None:
        """Give waiting questions their reports; a report that the host no longer waits for is kept for the next."""
        with self._lock:
            while self._waiting:
                report = self._kept or self.controller.next_report()
                if report is None:
                    return
                taken = self._waiting.popleft().complete(report)
                self._kept = None if taken else report
