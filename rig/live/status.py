"""Live pictures on the terminal: a line of status while they run, a table at the end."""

from __future__ import annotations

import sys
from types import TracebackType

from rich.console import Console
from rich.live import Live
from rich.text import Text

from rig.live.results import ShowResult
from rig.live.show.controls import KEYS
from rig.terminal import print_table, say


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


def print_live(result: ShowResult) -> None:
    """The result of `rig live` as a table, and its notes on the other stream."""
    if result.figures.frames:
        _print_figures(result)
    else:
        say(f"live, {result.strategy}, {result.seconds:.1f} s: no picture was shown")
    for note in result.notes:
        say(note, sys.stderr)


def _print_figures(result: ShowResult) -> None:
    figures, light = result.figures, result.light_latency_ms
    on_time = figures.on_time_share
    rows = [
        ("frames", figures.frames),
        ("frames a second, median", figures.fps_median),
        ("latency, median [ms]", figures.latency_ms.p50),
        ("latency, 99 of 100 below [ms]", figures.latency_ms.p99),
        ("computing, median [ms]", figures.compute_ms.p50),
        ("late", figures.late_frames),
        ("on time [%]", None if on_time is None else 100 * on_time),
        ("dropped: a newer one came first", figures.dropped),
        ("refreshes without a new frame", figures.repeated),
        ("out of order", figures.out_of_order),
        ("expected error, rms [grey levels]", figures.error_mean),
        ("growth of memory [MB]", result.memory_growth_mb),
    ]
    if light is not None:
        rows.append(("picture in memory to light, median [ms]", light.p50))
    print_table(f"live, {result.strategy}, {result.seconds:.1f} s", ("", "value"), rows)
