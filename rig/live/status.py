"""Live pictures on the terminal: a line of status while they run, a table at the end."""

from __future__ import annotations

from types import TracebackType
from typing import Any

from rich.console import Console
from rich.live import Live
from rich.text import Text

from rig.live.show.controls import KEYS
from rig.terminal import print_table


class StatusLine:
    """One line on stderr that is written over; nothing where stderr is no terminal. Use it in a ``with`` statement."""

    def __init__(self) -> None:
        self._console = Console(stderr=True)
        self._live = Live(console=self._console, auto_refresh=False, transient=True)
        self._started = False

    def __enter__(self) -> StatusLine:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._started:
            self._live.stop()

    def __call__(self, line: str) -> None:
        """Show a line, and what the keys do."""
        if not self._console.is_terminal:
            return
        if not self._started:
            self._live.start()
            self._started = True
        keys = " ".join(f"{key} {meaning} ·" for key, meaning in KEYS.items()).rstrip(" ·")
        self._live.update(Text(f"{line}\n{keys}", overflow="ellipsis", no_wrap=True), refresh=True)


def print_live(result: dict[str, Any]) -> None:
    """The result of `rig live` as a table."""
    latency = result["latency_ms"]
    rows = [
        ("frames", result["frames"]),
        ("frames a second, median", result["fps_median"]),
        ("latency, median [ms]", latency["p50"]),
        ("latency, 99 of 100 below [ms]", latency["p99"]),
        ("computing, median [ms]", result["compute_ms"]["p50"]),
        ("late", result["late_frames"]),
        ("on time [%]", None if result["on_time_share"] is None else 100 * result["on_time_share"]),
        ("dropped: a newer one came first", result["dropped"]),
        ("refreshes without a new frame", result["repeated"]),
        ("out of order", result["out_of_order"]),
        ("expected error, rms [grey levels]", result["error_mean"]),
        ("growth of memory [MB]", result["memory_growth_mb"]),
    ]
    if result["light_latency_ms"]:
        rows.append(("picture in memory to light, median [ms]", result["light_latency_ms"]["p50"]))
    print_table(f"live, {result['strategy']}, {result['seconds']:.1f} s", ("", "value"), rows)
    for note in result["notes"]:
        Console(stderr=True).print(note, style="yellow", markup=False, highlight=False)
