"""Other programs, as witnesses and as hands."""

import subprocess

from tests.device_lab.waiting import GENEROUS_S


def output_of(*command: object) -> str:
    """What a program prints; one that fails fails the test."""
    words = [str(word) for word in command]
    done = subprocess.run(words, capture_output=True, text=True, timeout=GENEROUS_S, check=False)
    assert done.returncode == 0, done.stderr + done.stdout
    return done.stdout + done.stderr
