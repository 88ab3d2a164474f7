"""A served page, with a finished session in its folder; and a browser, where there is one."""

import json
import os
import shutil
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import pytest

from tests.rig.conftest import Finished

ME = {"x-rig-client": "me"}
PATIENCE_S = 120.0


@dataclass(frozen=True)
class Served:
    """A running `rig serve`."""

    root: Path
    address: str
    process: subprocess.Popen[str]

    @property
    def port(self) -> int:
        return int(self.address.split(":")[2].split("/")[0])

    def get(self, path: str, **more: Any) -> httpx.Response:
        return httpx.get(self.address.split("?")[0] + path.lstrip("/"), timeout=60, verify=False, **more)

    def post(self, path: str, body: object = None, client: str = "me") -> httpx.Response:
        headers = {"x-rig-client": client}
        return httpx.post(self.address + path.lstrip("/"), json=body or {}, headers=headers, timeout=60, verify=False)

    def job(self) -> dict[str, Any]:
        return self.get("/api/job").json()  # type: ignore[no-any-return]

    def until(self, is_so: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """Ask for the job until something is so."""
        end_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < end_s:
            if is_so(found := self.job()):
                return found
            time.sleep(0.1)  # noqa: TID251 - another process works
        raise TimeoutError(f"still not so: {json.dumps(found)[:2000]}")

    def raw(self, request: bytes) -> bytes:
        """Send bytes as they are, and return how the answer begins."""
        with socket.create_connection(("127.0.0.1", self.port), 30) as connection:
            connection.sendall(request)
            return connection.recv(1 << 16)


@contextmanager
def serving(root: Path, *options: str) -> Iterator[Served]:
    """Run `rig serve` on a free port, as a person would, and end it as a person would."""
    command = [sys.executable, "-m", "rig", "serve", str(root), "--port", "0", *options]
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    ) as process:
        assert process.stdout is not None
        address = process.stdout.readline().strip()
        served = Served(root, address, process)
        try:
            assert address.startswith("http://"), process.stderr.read() if process.stderr else ""
            _wait(address.split("?")[0] + "health")
            yield served
        finally:
            process.terminate()
            process.communicate(timeout=60)


def _wait(address: str) -> None:
    for _ in range(300):
        try:
            urllib.request.urlopen(address, timeout=5).close()
        except OSError:
            time.sleep(0.1)  # noqa: TID251 - another process starts
        else:
            return
    raise TimeoutError(address)


@pytest.fixture(scope="session")
def served(tmp_path_factory: pytest.TempPathFactory, finished: Finished) -> Iterator[Served]:
    """A server for tests that leave nothing at work."""
    root = tmp_path_factory.mktemp("served")
    shutil.copytree(finished.folder, root / "first")
    with serving(root) as found:
        yield found
