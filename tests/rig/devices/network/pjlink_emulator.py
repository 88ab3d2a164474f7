"""A projector's network control, emulated on this machine; the tests' counterpart of `rig.devices.network.pjlink`."""

import contextlib
import hashlib
import socket
import socketserver
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

SEED = "498e4a67"
CLASS_1 = {
    "1POWR": "0",
    "1INPT": "11",
    "1AVMT": "30",
    "1ERST": "000000",
    "1LAMP": "1234 0",
    "1INST": "11 21 31 32",
    "1NAME": "Wall",
    "1INF1": "Maker",
    "1INF2": "Model 5",
    "1INFO": "fits",
    "1CLSS": "1",
}
CLASS_2 = CLASS_1 | {
    "1CLSS": "2",
    "2INPT": "11",
    "2INST": "11 31 3A 61",
    "2SNUM": "SN 0042",
    "2SVER": "1.07",
    "2IRES": "1920x1080",
    "2RRES": "1920x1200",
    "2FILT": "77",
    "2RLMP": "LMP-1 LMP-2",
    "2RFIL": "FLT-9",
    "2FREZ": "0",
}
SETTINGS = {"1POWR", "1INPT", "2INPT", "1AVMT", "2FREZ"}
FAULTS = {
    "hang up": b"",
    "half a greeting": b"PJLI",
    "garbage": bytes(range(128, 256)) + b"\r",
    "another protocol": b"220 mail.example ESMTP\r\n",
    "endless line": b"A" * 5000,
}
"""What a broken projector sends before it hangs up."""


@dataclass(kw_only=True)
class EmulatedProjector:
    """What a projector knows and does. `answers` overrule: a command line without % to a whole answer line."""

    state: dict[str, str] = field(default_factory=CLASS_2.copy)
    password: str | None = None
    answers: dict[str, str] = field(default_factory=dict)
    fault: str | None = None
    power_changes: list[str] = field(default_factory=list)
    """What POWR answers, one after the other, before it stays as it is."""
    commands: list[str] = field(default_factory=list)
    connections: int = 0
    port: int = 0

    def answer(self, line: str) -> str:
        """The whole answer to a command line without %."""
        self.commands.append(line)
        if line in self.answers:
            return self.answers[line]
        command, _, parameter = line.partition(" ")
        return f"%{command}={self._value(command, parameter)}"

    def _value(self, command: str, parameter: str) -> str:
        if command == "2INNM":
            return f"HDMI {parameter[1:]}"
        if command not in self.state:
            return "ERR1"
        if parameter == "?":
            if command == "1POWR" and self.power_changes:
                self.state["1POWR"] = self.power_changes.pop(0)
            return self.state[command]
        return self._set(command, parameter)

    def _set(self, command: str, parameter: str) -> str:
        if command[1:] == "INPT" and parameter not in self.state[command[0] + "INST"].split():
            return "ERR2"
        if command != "1POWR" and self.state["1POWR"] != "1":
            return "ERR3"
        if command in SETTINGS:
            self.state[command] = parameter
        if command == "1POWR" and parameter == "1":
            self.power_changes = ["3", "3", "1"]
        return "OK"


class _Handler(socketserver.StreamRequestHandler):
    server: "_Server"
    timeout = 30

    def handle(self) -> None:
        projector = self.server.projector
        projector.connections += 1
        with contextlib.suppress(ConnectionError):
            if projector.fault in FAULTS:
                self.request.sendall(FAULTS[projector.fault])
            elif projector.fault == "silence":
                self.request.recv(1)
            else:
                self._talk(projector)

    def _talk(self, projector: EmulatedProjector) -> None:
        digest = ""
        if projector.password is not None:
            digest = hashlib.md5((SEED + projector.password).encode()).hexdigest()
        self.request.sendall(f"PJLINK 1 {SEED}\r".encode() if digest else b"PJLINK 0\r")
        while line := self._line():
            if not line.startswith(f"{digest}%"):
                self.request.sendall(b"PJLINK ERRA\r")
                return
            answer = projector.answer(line.removeprefix(f"{digest}%"))
            digest = ""
            if projector.fault == "hang up in an answer":
                self.request.sendall(answer[:4].encode())
                return
            if projector.fault == "slow letters":
                for letter in answer:
                    self.request.sendall(letter.encode())
                    if select_readable(self.request, 0.2):
                        return
            self.request.sendall(f"{answer}\r".encode())

    def _line(self) -> str:
        line = b""
        while not line.endswith(b"\r"):
            received = self.request.recv(1)
            if not received:
                return ""
            line += received
        return line[:-1].decode()


def select_readable(connection: socket.socket, timeout_s: float) -> bool:
    """Whether the other side says something, or hangs up, within a time."""
    connection.settimeout(timeout_s)
    with contextlib.suppress(TimeoutError):
        connection.recv(1)
        return True
    connection.settimeout(30)
    return False


class _Server(socketserver.ThreadingTCPServer):
    allow_reuse_address = True
    projector: EmulatedProjector


@contextmanager
def served(projector: EmulatedProjector) -> Iterator[EmulatedProjector]:
    """Serve a projector on a port of 127.0.0.1 that `port` then says."""
    with _Server(("127.0.0.1", 0), _Handler) as server:
        server.projector = projector
        projector.port = server.server_address[1]
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        try:
            yield projector
        finally:
            server.shutdown()
            thread.join()
