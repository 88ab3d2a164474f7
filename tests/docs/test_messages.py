"""The table of messages is that of the code, and each message says enough to act on."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
NEXT = re.compile(
    r"[;?]|: (?!\*)|[.,] (?:Check|Correct|Look|Move|Aim|e\.g\.)"
    r"|give|copy them|needs? |are needed|must |should be|belong together"
)
"""What a sentence has that says what to do next, or what is wanted."""
BUILT_UP = re.compile(
    r"^((\*[^*]+\*|with|as|read|at|does|not|answer|is|there|camera|strategy|mesh|bad|geometry)[ ,:()]*)+$"
)
"""Words that another message, which has its own row, completes."""
TO_PROGRAMMERS = (
    "the aim is at the lens",
    "this stage photographs nothing, so it has no rig",
    "first patch *first patch*, expected *first*",
    "is closed",
    "the limit is *MOST DISTANCE SIGMA* %: *solution*",
    "unplugged_s says",
    "*name* was set to *value*, the camera has *got**name*",
    "*times*. With places as they are: *error*",
)
"""Caught within, of a wrong call, of a fault that a simulated device was told to have; or followed by a second text."""


def made() -> str:
    code = "import sys; sys.path.insert(0, 'docs/site'); import messages; print(messages.page(), end='')"
    return subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True).stdout


def test_the_table_of_messages_is_up_to_date() -> None:
    written = (ROOT / "docs" / "reference" / "messages.md").read_text(encoding="utf-8")
    assert written == made(), "run: python docs/site/messages.py"


def test_every_error_of_the_trees_has_its_row_and_its_exit_status() -> None:
    table = made()
    for row in (
        "`DeviceLost`](#devicelost) | 3 |",
        "`SessionLocked`](#sessionlocked) | 4 |",
        "`ProfileError`](#profileerror) | 2 |",
    ):
        assert row in table
    assert table.count("\n| ") > 300


def test_every_message_says_what_to_do_or_what_is_wanted() -> None:
    """Each was read by a person; this holds what is added later to the same question: would I know what to do?"""
    words = [row.removeprefix("| ").rsplit(" | `", 1)[0] for row in made().splitlines() if row.endswith("` |")]
    silent = [
        said
        for said in words
        if not (NEXT.search(said) or BUILT_UP.match(said) or any(known in said for known in TO_PROGRAMMERS))
    ]
    assert len(words) > 600
    assert silent == []
