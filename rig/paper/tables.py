"""The replication of the paper as tables on the terminal."""

from __future__ import annotations

from typing import Any

from rich.console import Console

from rig.paper.experiments import paper_table
from rig.paper.scores import strategies_table

_WIDTH = 128
"""Characters: narrower than this the table cannot be read."""


def print_paper(result: dict[str, Any]) -> None:
    """The six configurations, the published figures under each; not narrower than it can be read."""
    console = Console(width=max(Console().width, _WIDTH))
    console.print(paper_table(result))
    console.print(strategies_table(result["configurations"]))
    for name, text in result["conventions"].items():
        print(f"{name}: {text}")
    for text in result["exceptions"]:
        print(f"exception: {text}")
