"""PJLink, classes 1 and 2: a projector's power, input, shutter and state over the network.

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


class Health(Enum):
    """Of one part of the projector; the values are PJLink's."""

    OK = "0"
    WARNING = "1"
    ERROR = "2"


@dataclass(frozen=True, slots=True)
class ErrorStatus:
    """What the projector finds wrong with itself; what it does not watch is OK."""

    fan: Health
    lamp: Health
    temperature: Health
    cover: Health
    filter: Health
    other: Health


@dataclass(frozen=True, slots=True)
class Lamp:
    """A light source: hours of light so far, and whether it is lit."""

    hours: int
    lit: bool


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
            raise DeviceError(f"{self.where} answers {answer!r} to {command!r} instead of OK")

    def _get(self, command: str, pattern: str = ".*") -> re.Match[str]:
        """The answer to a question, if it has the right form."""
        (answer,) = self.ask(f"{command} ?")
        match = re.fullmatch(pattern, answer.strip())
        if match is None:
            raise DeviceError(f"{self.where} answers {answer!r} to {command!r}, which PJLink does not know")
        return match

    def _text(self, command: str) -> str:
        return self._get(command)[0]

    def power(self) -> Power:
        """What the lamp does."""
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

    def input_name(self, code: str) -> str:
        """What the projector's menu calls an input. Class 2."""
        (name,) = self.ask(f"2INNM ?{code}")
        return name

    def mute(self) -> Mute:
        """Whether picture and sound are muted."""
        which, on = self._get("1AVMT", "([1-3])([01])").groups()
        return Mute(picture=on == "1" and which != "2", sound=on == "1" and which != "1")

    def set_mute(self, on: bool) -> None:
        """Make picture and sound dark and silent, or let them through; the lamp stays as it is."""
        try:
            self._set("1AVMT", f"3{on:d}")
        except SettingRefused:  # some can only do one of the two
            self._set("1AVMT", f"1{on:d}")

    def error_status(self) -> ErrorStatus:
        """What the projector finds wrong with itself."""
        return ErrorStatus(*(Health(digit) for digit in self._get("1ERST", "[0-2]{6}")[0]))

    def lamps(self) -> list[Lamp]:
        """Every light source; empty when the projector counts none."""
        try:
            words = self._get("1LAMP", r"\d{1,5} [01]( \d{1,5} [01])*")[0].split()
        except SettingRefused:
            return []
        return [Lamp(int(hours), lit == "1") for hours, lit in zip(words[::2], words[1::2], strict=True)]

    def name(self) -> str:
        """The name that somebody gave it."""
        return self._text("1NAME")

    def manufacturer(self) -> str:
        """Who made it."""
        return self._text("1INF1")

    def product(self) -> str:
        """Its model."""
        return self._text("1INF2")

    def other_information(self) -> str:
        """Whatever else its maker tells."""
        return self._text("1INFO")

    def pjlink_class(self) -> int:
        """1, or 2."""
        return int(self._get("1CLSS", "[1-9]")[0])

    def serial(self) -> str:
        """Serial number. Class 2."""
        return self._text("2SNUM")

    def software_version(self) -> str:
        """Of the projector. Class 2."""
        return self._text("2SVER")

    def resolution(self) -> tuple[int, int] | None:
        """(height, width) in pixels of the signal at the input; None without one. Class 2."""
        return _shape(self._get("2IRES", r"\d+x\d+|-|\*")[0])

    def recommended_resolution(self) -> tuple[int, int] | None:
        """(height, width) in pixels that the projector wants. Class 2."""
        return _shape(self._get("2RRES", r"\d+x\d+")[0])

    def filter_hours(self) -> int:
        """Hours that the filter was in use. Class 2; SettingRefused without a filter."""
        return int(self._get("2FILT", r"\d{1,5}")[0])

    def lamp_models(self) -> list[str]:
        """Model numbers of replacement lamps. Class 2."""
        return self._text("2RLMP").split()

    def filter_models(self) -> list[str]:
        """Model numbers of replacement filters. Class 2."""
        return self._text("2RFIL").split()

    def frozen(self) -> bool:
        """Whether the picture stands still, whatever the signal. Class 2."""
        return self._get("2FREZ", "[01]")[0] == "1"

    def freeze(self, on: bool) -> None:
        """Hold the picture, or let it follow the signal. Class 2."""
        self._set("2FREZ", f"{on:d}")

    def _newest(self) -> int:
        """The class to ask in: inputs beyond 9 and of kind 6 exist in class 2 only."""
        return min(self.pjlink_class(), 2)


_ERRORS: dict[str, tuple[type[DeviceError], str]] = {
    "ERR1": (SettingRefused, "it does not know this command; is it of PJLink class 2, and has it this part?"),
    "ERR2": (SettingRefused, "it does not have this; choose another parameter"),
    "ERR3": (DeviceBusy, "it cannot do this now; switch it on, or wait until it has warmed up or cooled down"),
    "ERR4": (DeviceError, "it reports a failure; look at its indicators and its error status"),
}


def _shape(text: str) -> tuple[int, int] | None:
    width, found, height = text.partition("x")
    return (int(height), int(width)) if found else None


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
