"""The rig's end of the process that owns the window."""

from __future__ import annotations

import json
import mmap
import os
import signal
import socket
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import IO, Any, TypeAlias

from rig.devices.window.monitor import FoundMonitor
from rig.errors import DeviceError, DeviceLost, SettingRefused

Message: TypeAlias = dict[str, Any]
"""One JSON object, as it goes between the two processes."""
START_LIMIT_S = 30.0
"""To load the libraries, reach the display server and put a window on it."""
SHOW_LIMIT_S = 5.0
"""For one picture; a desktop that is locked presents none."""
_END_LIMIT_S = 2.0
_PACKET_BYTES = 1 << 16
_PROBLEMS = {"lost": DeviceLost, "refused": SettingRefused}
_INSTALL = "a projector as a window needs two more packages: pip install 'procam-rig[window]'"
_NO_DESKTOP = (
    "no desktop to put a window on: {}; run this inside the desktop session, "
    'or, on a machine without a desktop, use driver = "kms"'
)


class ScreenLink:
    """Starts the screen's process and talks to it. ``monitors`` are the monitors that it sees.

    ``picture_bytes`` is the size of the picture that both share. Raises DeviceError without a desktop, or without
    the packages of the extra ``window``.
    """

    def __init__(self, picture_bytes: int = 1):
        if not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
            raise DeviceError(_NO_DESKTOP.format("neither DISPLAY nor WAYLAND_DISPLAY is set"))
        self._log = tempfile.TemporaryFile()
        memory = os.memfd_create("procam-rig-picture")
        os.ftruncate(memory, picture_bytes)
        self.picture = mmap.mmap(memory, picture_bytes)
        self._socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._process = _start(theirs.fileno(), memory, self._log)
        theirs.close()
        os.close(memory)
        try:
            self.monitors = [FoundMonitor(**monitor) for monitor in self._answer(START_LIMIT_S)["monitors"]]
        except DeviceError:
            self.close()
            raise

    def open_window(self, index: int) -> None:
        """Fill a monitor with black. Raises DeviceLost, SettingRefused, DeviceError."""
        self._request({"open": index}, START_LIMIT_S)

    def show(self) -> None:
        """Present the shared picture; returns when that is done. Raises DeviceLost, SettingRefused."""
        self._request({"show": True}, SHOW_LIMIT_S)

    def close(self) -> None:
        """End the process, and with it the window; black first if it can."""
        self._socket.close()
        try:
            self._process.wait(_END_LIMIT_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._log.close()

    def _request(self, request: Message, limit_s: float) -> None:
        try:
            self._socket.send(json.dumps(request).encode())
        except OSError as error:
            raise self._died() from error
        self._answer(limit_s)

    def _answer(self, limit_s: float) -> Message:
        self._socket.settimeout(limit_s)
        try:
            packet = self._socket.recv(_PACKET_BYTES)
        except TimeoutError:
            self._process.kill()
            raise DeviceLost(
                f"the desktop did not present a picture within {limit_s:g} s; is the session locked, the monitor off?"
            ) from None
        except OSError as error:
            raise self._died() from error
        if not packet:
            raise self._died()
        answer: Message = json.loads(packet)
        if "problem" in answer:
            raise _problem(answer["problem"], answer["message"])
        return answer

    def _died(self) -> DeviceLost:
        """What is known of a process that is gone."""
        try:
            status = self._process.wait(_END_LIMIT_S)
        except subprocess.TimeoutExpired:
            status = 0
        how = signal.Signals(-status).name if status < 0 else f"status {status}"
        self._log.seek(0)
        words = self._log.read().decode(errors="replace").strip().splitlines()
        return DeviceLost(
            f"the window's process ended ({how}: {words[-1] if words else 'no message'}); "
            "is the display server still there? Open the rig again"
        )


def _start(link: int, memory: int, log: IO[bytes]) -> subprocess.Popen[bytes]:
    script = Path(__file__).with_name("screen.py")
    return subprocess.Popen(
        [sys.executable, "-P", str(script), str(link), str(memory)],
        stdin=subprocess.DEVNULL,
        stdout=log,
        stderr=log,
        pass_fds=(link, memory),
    )


def _problem(kind: str, message: str) -> DeviceError:
    if kind == "missing":
        return DeviceError(f"{_INSTALL} ({message})")
    if kind == "failed":
        return DeviceError(_NO_DESKTOP.format(message))
    return _PROBLEMS[kind](message)
