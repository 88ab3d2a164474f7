"""The thread that reads sources, one after the other, into the mailbox; whatever happens to a source, it goes on."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Sequence

import cv2
import numpy as np

from rig.devices.protocols import Clock
from rig.errors import RigError
from rig.files.pictures import MOST_PX, cover, covering_shape
from rig.live.show.frame_mailbox import FrameMailbox
from rig.live.show.priority import normal_priority
from rig.live.sources.source import Picture, Pixels, Source, SourceBroken, SourceEnded

_READ_S = 0.1
"""How long a source may make the reader deaf to requests."""
_SAME_RATE = 0.01
"""A source whose pace is that close to the display's, or to an n-th of it, is played in the display's."""
_UNFORESEEN = (OSError, MemoryError, ValueError, ArithmeticError, RuntimeError, cv2.error)
"""What decoders and the system raise in a source: its failure is told as any other, and not lost in a thread."""
_KEPT_NOTES = 50
"""A source that breaks in an endless loop must not fill the memory."""
_PAUSE_S, _LONGEST_PAUSE_S = 0.5, 8.0
"""After a failure, before the next try: twice as long each time, so that a source is back within ten seconds."""


def locked_rate(rate_hz: float, refresh_rate_hz: float) -> float:
    """The pace to play a source in: the display's n-th where that is near enough to be invisible."""
    divisor = max(round(refresh_rate_hz / rate_hz), 1)
    near_hz = refresh_rate_hz / divisor
    return near_hz if abs(rate_hz / near_hz - 1) <= _SAME_RATE else rate_hz


class Fitter:
    """Scales pictures to cover a shape, and crops what stands over; allocates only when their size changes."""

    def __init__(self, shape: tuple[int, int]):
        self._shape = shape
        self._scaled = np.empty((0, 0, 3), np.uint8)

    def fit(self, picture: Picture, out: Pixels) -> None:
        """Write a picture of any size to ``out``, (H, W, 3) of the shape, red first."""
        scaled = covering_shape(picture.pixels.shape, self._shape)
        is_huge = scaled[0] * scaled[1] > MOST_PX
        if scaled != self._scaled.shape[:2] and picture.pixels.shape[:2] != self._shape and not is_huge:
            self._scaled = np.empty((*scaled, 3), np.uint8)
        fitted = cover(picture.pixels, self._shape, cv2.INTER_LINEAR, self._scaled)
        if picture.is_bgr:
            cv2.cvtColor(fitted, cv2.COLOR_BGR2RGB, dst=out)
        else:
            np.copyto(out, fitted)


class Reader:
    """Reads sources in a thread of its own.

    Parameters
    ----------
    sources
        Played one after the other, each to its end.
    mailbox
        Where the pictures go.
    shape
        (height, width) that they are scaled to.
    refresh_rate_hz
        Of the display.
    endless
        Begin again after the last source; one that gave no picture is given up.
    keeps_going
        A source that fails is tried again, later and later, and black is shown meanwhile.
    clock
        The machine's.
    """

    def __init__(
        self,
        sources: Sequence[Source],
        mailbox: FrameMailbox,
        *,
        shape: tuple[int, int],
        refresh_rate_hz: float,
        clock: Clock,
        endless: bool,
        keeps_going: bool = False,
    ):
        self.notes: list[str] = []
        """What went wrong with sources, the first of it."""
        self.failure: RigError | None = None
        """The first that was not overcome; None when all sources gave what they had."""
        self._keeps_going = keeps_going
        self._pause_s = _PAUSE_S
        self._left = list(sources)
        self._mailbox = mailbox
        self._fitter = Fitter(shape)
        self._refresh_rate_hz = refresh_rate_hz
        self._clock = clock
        self._endless = endless
        self._next = threading.Event()
        self._stop = threading.Event()
        self._name = ""
        self._count = 0
        self._thread = threading.Thread(target=self._run, name="live source", daemon=True)

    @property
    def name(self) -> str:
        """The name of the source that is being read."""
        return self._name

    def start(self) -> None:
        """Begin to read."""
        self._thread.start()

    def next_source(self) -> None:
        """Leave the current source; its turn comes again after the others."""
        self._next.set()
        self._mailbox.restart()

    def close(self) -> None:
        """Stop, and wait for the thread as long as a source may be deaf."""
        self._stop.set()
        self._mailbox.close()
        if self._thread.ident is not None:
            self._thread.join(20 * _READ_S)

    def _run(self) -> None:
        normal_priority()
        try:
            while self._left and not self._stop.is_set():
                source = self._left.pop(0)
                has_failed = self._play(source)
                is_wanted = self._keeps_going if has_failed else self._endless and self._count > 0
                if self._next.is_set() or is_wanted:
                    self._left.append(source)
        finally:
            self._mailbox.finish()

    def _play(self, source: Source) -> bool:
        """Read a source to its end; True when that was a failure."""
        self._name, self._count = source.name, 0
        self._next.clear()
        self._mailbox.restart()
        try:
            source.open()
            self._read_all(source)
        except RigError as error:
            self._fail(error)
            return True
        except _UNFORESEEN as error:
            self._fail(SourceBroken(f"{self._name}: {type(error).__name__}: {error}; look at what it gives"))
            return True
        finally:
            source.close()
        return False

    def _fail(self, error: RigError) -> None:
        """Note a failure; where the show keeps going, show black and wait, longer each time."""
        self._note(str(error))
        self.failure = self.failure or error
        if not self._keeps_going:
            return
        self._mailbox.restart()
        self._mailbox.writable()[:] = 0
        self._mailbox.offer(None)
        until_s = self._clock.now_s() + self._pause_s
        while (left_s := until_s - self._clock.now_s()) > 0 and not (self._stop.is_set() or self._next.is_set()):
            self._stop.wait(min(left_s, _READ_S))
        self._pause_s = min(2 * self._pause_s, _LONGEST_PAUSE_S)

    def _read_all(self, source: Source) -> None:
        rate_hz = source.frame_rate_hz
        period_s = None if rate_hz is None else 1 / locked_rate(rate_hz, self._refresh_rate_hz)
        while not (self._stop.is_set() or self._next.is_set()):
            try:
                picture = source.read(_READ_S)
            except SourceEnded as end:
                self._note_once(end.args)
                self._mailbox.hold(self._count * (period_s or 0.0))
                return
            if picture is not None:
                self._note_once(picture.told)
                self._fitter.fit(picture, self._mailbox.writable())
                self._mailbox.offer(None if period_s is None else self._count * period_s)
                self._count += 1
                if self._keeps_going:
                    self.failure, self._pause_s = None, _PAUSE_S

    def _note(self, text: str) -> None:
        if len(self.notes) < _KEPT_NOTES:
            self.notes.append(text)

    def _note_once(self, texts: Iterable[str]) -> None:
        """Keep each that is new: a folder that is played for ever passes over the same each time."""
        for text in texts:
            if text not in self.notes:
                self._note(text)
