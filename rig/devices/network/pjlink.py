"""PJLink, classes 1 and 2: a projector's power, input and shutter over the network.

Written from the public specification (JBMIA, version 2.00 of 2017-01-31) and tested against an emulation; never seen
on a real projector by us. A command is ``%``, the class, four letters, a space, a parameter or ``?``, and a carriage
return; the answer repeats it with ``=``. A projector with a password sends a seed first, and takes one command that
begins with the MD5 of seed and password; after that the connection is trusted, until it was idle for 30 s. So every
call here makes its own connection, and :meth:`Pjlink.ask` asks several things on one.
"""

from __future__ import annotations

import hashlib
import re
import socket
import time
from contextlib import closing
from dataclasses import dataclass
from enum import Enum

from rig.errors import DeviceBusy, DeviceError, DeviceForbidden, DeviceLost, SettingRefused

PORT = 4352
_LINE_LIMIT_BYTES = 1024
"""Far more than the specification's 136."""


class Power(Enum):
    """What the lamp does; the values are PJLink's."""

    STANDBY = "0"
    ON = "1"
    COOLING = "2"
    WARMING_UP = "3"


@dataclass(frozen=True, slots=True)
class Mute:
    """Whether the picture is dark and the sound off."""

    picture: bool
    sound: bool


class Pjlink:
    """A projector's network control. Nothing is sent before the first call.

    Every call raises DeviceLost when the projector is silent or hangs up, DeviceForbidden when it wants another
    password, SettingRefused when it does not know the command or the parameter (ERR1, ERR2), DeviceBusy when it cannot
    now (ERR3), and DeviceError when it reports a failure (ERR4) or answers what is no PJLink.

    Parameters
    ----------
    host
        Name or address.
    port
        TCP port.
    password
        None when the projector has none.
    timeout_s
        To connect, and for each answer. The specification gives a projector 2 s; some need more while they warm up.
    """

    def __init__(self, host: str, port: int = PORT, password: str | None = None, timeout_s: float = 5.0):
        self._host = host
        self._port = port
        self._password = password
        self._timeout_s = timeout_s

    @property
    def where(self) -> str:
        """What messages call it."""
        return f"the projector at {self._host}:{self._port}"

    def ask(self, *commands: str) -> list[str]:
        """Send commands on one connection, such as ``1POWR ?``; returns what stands behind ``=`` in each answer."""
        try:
            connection = socket.create_connection((self._host, self._port), self._timeout_s)
        except OSError as error:
            raise DeviceLost(
                f"{self.where} cannot be reached: {error.strerror or error}; is it plugged in, and its network control "
                "switched on (also in standby)?"
            ) from error
        with closing(connection):
            return self._talk(_Lines(connection, self._timeout_s, self.where), commands)

    def _talk(self, lines: _Lines, commands: tuple[str, ...]) -> list[str]:
        digest = self._digest(lines.read())
        answers = []
        for number, command in enumerate(commands):
            lines.write((digest if number == 0 else "") + f"%{command}\r")
            answers.append(self._checked(command, lines.read()))
        return answers

    def _digest(self, greeting: str) -> str:
        """What the first command begins with."""
        words = greeting.split()
        if [word.upper() for word in words] == ["PJLINK", "0"]:
            return ""
        if len(words) != 3 or [word.upper() for word in words[:2]] != ["PJLINK", "1"]:
            raise DeviceError(f"{self.where} greets with {greeting!r}, which is no PJLink; check host and port")
        if self._password is None:
            raise DeviceForbidden(
                f"{self.where} wants a password: name its variable in projector.pjlink.password_variable"
            )
        return hashlib.md5((words[2] + self._password).encode(), usedforsecurity=False).hexdigest()

    def _checked(self, command: str, answer: str) -> str:
        """The answer's value, if it is the answer to this command."""
        if answer.upper() == "PJLINK ERRA":
            raise DeviceForbidden(
                f"{self.where} does not accept the password; correct projector.pjlink.password_variable"
            )
        head, equals, value = answer.partition("=")
        if head.upper() != f"%{command[:5]}" or not equals:
            raise DeviceError(f"{self.where} answers {answer!r} to {command!r}; does another program control it?")
        if value.upper() in _ERRORS:
            kind, text = _ERRORS[value.upper()]
            raise kind(f"{self.where} answers {value.upper()} to {command!r}: {text}")
        return value

    def _set(self, command: str, parameter: str) -> None:
        (answer,) = self.ask(f"{command} {parameter}")
        if answer.upper() != "OK":
            raise DeviceError(
                f"{self.where} answers {answer!r} to {command!r} instead of OK; try again, or use its remote control"
            )

    def _get(self, command: str, pattern: str = ".*") -> re.Match[str]:
        """The answer to a question, if it has the right form."""
        (answer,) = self.ask(f"{command} ?")
        match = re.fullmatch(pattern, answer.strip())
        if match is None:
            raise DeviceError(
                f"{self.where} answers {answer!r} to {command!r}, which PJLink does not know; "
                "update its firmware, or leave projector.pjlink out"
            )
        return match

    def power(self) -> Power:
        """Return what the lamp does."""
        return Power(self._get("1POWR", "[0-3]")[0])

    def switch_on(self) -> None:
        """Begin to warm up; DeviceBusy while it cools down."""
        self._set("1POWR", "1")

    def switch_off(self) -> None:
        """Begin to cool down; DeviceBusy while it warms up."""
        self._set("1POWR", "0")

    def inputs(self) -> list[str]:
        """Codes of all inputs: a kind (1 RGB, 2 video, 3 digital, 4 storage, 5 network, 6 internal), a number."""
        return self._get(f"{self._newest()}INST", r"[1-6][1-9A-Z]( [1-6][1-9A-Z])*")[0].split()

    def input(self) -> str:
        """Code of the input that is shown."""
        return self._get(f"{self._newest()}INPT", "[1-6][1-9A-Z]")[0]

    def select_input(self, code: str) -> None:
        """Show another input; SettingRefused when there is none of that code."""
        self._set(f"{self._newest()}INPT", code)

    def mute(self) -> Mute:
        """Return whether picture and sound are muted."""
        which, on = self._get("1AVMT", "([1-3])([01])").groups()
        return Mute(picture=on == "1" and which != "2", sound=on == "1" and which != "1")

    def set_mute(self, on: bool) -> None:
        """Make picture and sound dark and silent, or let them through; the lamp stays as it is."""
        try:
            self._set("1AVMT", f"3{on:d}")
        except SettingRefused:  # some can only do one of the two
            self._set("1AVMT", f"1{on:d}")

    def pjlink_class(self) -> int:
        """1, or 2."""
        return int(self._get("1CLSS", "[1-9]")[0])

    def _newest(self) -> int:
        """The class to ask in: inputs beyond 9 and of kind 6 exist in class 2 only."""
        return min(self.pjlink_class(), 2)


_ERRORS: dict[str, tuple[type[DeviceError], str]] = {
    "ERR1": (SettingRefused, "it does not know this command; is it of PJLink class 2, and has it this part?"),
    "ERR2": (SettingRefused, "it does not have this; choose another parameter"),
    "ERR3": (DeviceBusy, "it cannot do this now; switch it on, or wait until it has warmed up or cooled down"),
    "ERR4": (DeviceError, "it reports a failure; look at its indicators and its error status"),
}


class _Lines:
    """Lines of text that end with a carriage return, over a socket; each within a time limit."""

    def __init__(self, connection: socket.socket, timeout_s: float, where: str):
        self._connection = connection
        self._timeout_s = timeout_s
        self._where = where
        self._rest = b""

    def write(self, line: str) -> None:
        try:
            self._connection.sendall(line.encode())
        except OSError as error:
            raise DeviceLost(f"{self._where} hung up: {error.strerror or error}; try again") from error

    def read(self) -> str:
        until_s = time.monotonic() + self._timeout_s
        while b"\r" not in self._rest:
            if len(self._rest) > _LINE_LIMIT_BYTES:
                raise DeviceError(f"{self._where} sends lines of over {_LINE_LIMIT_BYTES} bytes; check host and port")
            self._rest += self._receive(until_s - time.monotonic())
        line, _, self._rest = self._rest.partition(b"\r")
        return line.decode(errors="replace").lstrip("\n")

    def _receive(self, remaining_s: float) -> bytes:
        try:
            self._connection.settimeout(max(remaining_s, 1e-3))
            received = self._connection.recv(_LINE_LIMIT_BYTES)
        except TimeoutError as error:
            raise DeviceLost(
                f"{self._where} did not answer within {self._timeout_s:g} s; it may serve one program at a time: "
                "end the others"
            ) from error
        except OSError as error:
            raise DeviceLost(f"{self._where} hung up: {error.strerror or error}; try again") from error
        if not received:
            raise DeviceLost(f"{self._where} hung up in the middle of an answer; try again")
        return received
