"""`rig live` as a program of its own on a display of 640 x 480 pixels."""

import json
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tests.contract.lab import display_profile
from tests.device_lab.waiting import GENEROUS_S


class LiveShow:
    """A show that runs until it is ended."""

    def __init__(self, process: subprocess.Popen[str]):
        self.process = process

    def end(self, number: int) -> dict[str, Any]:
        """Send a signal, and return what the show says of itself."""
        self.process.send_signal(number)
        out, _ = self.process.communicate(timeout=GENEROUS_S)
        result: dict[str, Any] = json.loads(out)
        return result


@contextmanager
def live_show(
    driver: str, output: str, folder: Path, environment: Mapping[str, str] | None = None
) -> Iterator[LiveShow]:
    """Show the test pattern on an output, as it is: these displays have no room around them."""
    profile = folder / "live.toml"
    profile.write_bytes(display_profile(driver, output).raw)
    command = [sys.executable, "-m", "rig", "live", "-p", str(profile), "--strategy", "none", "--json"]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stdin=subprocess.DEVNULL, text=True, env={**os.environ, **(environment or {})}
    )
    try:
        yield LiveShow(process)
    finally:
        process.kill()
        process.wait()
        if process.stdout is not None:
            process.stdout.close()
