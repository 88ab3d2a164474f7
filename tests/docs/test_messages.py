"""The table of messages is that of the code, and each message says enough to act on."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


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
