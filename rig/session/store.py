"""The session: a folder with all that a run of the rig has seen and found; it survives being killed."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import TypeVar

from rig.errors import SessionCorrupt, SessionError
from rig.files.atomic import PART_SUFFIX, write_bytes
from rig.files.journal import JOURNAL_NAME, Event, Journal
from rig.profile.schema import Profile
from rig.records import JsonObject, Record, json_of, read_record
from rig.session.folder import (
    check_folder,
    finish_profile_change,
    is_session,
    own_command,
    own_versions,
    read_folder,
    read_or_create,
    typed,
)
from rig.session.ledger import METRICS_NAME, FileEntry, Ledger, hash_json
from rig.session.lock import SessionLock
from rig.session.step import Step, check_name
from rig.terminal.line import counted

Kind = TypeVar("Kind")


class Session:
    """A session's folder, open for one process; use it in a ``with`` statement.

    :meth:`open` and :meth:`read` make one.

    Parameters
    ----------
    folder
        Where it is.
    profile
        What it was made with.
    ledger
        What its journal says.
    lock
        That this process holds; None to read alone.
    """

    def __init__(self, folder: Path, profile: Profile, ledger: Ledger, lock: SessionLock | None):
        self.path = folder
        self.profile = profile
        self._ledger = ledger
        self._lock = lock

    @classmethod
    def open(
        cls,
        path: str | os.PathLike[str],
        profile: Profile | None = None,
        *,
        seed: int = 1,
    ) -> Session:
        """Open a session, or make one when a profile is given and there is none.

        Parameters
        ----------
        path
            Its folder.
        profile
            Needed for a new session; later left out, or one that differs only in what may change (``CHANGEABLE``).
        seed
            Of a new session, for every random choice in it.

        Returns
        -------
        Session
            Open; it is this process's until :meth:`close`.

        Raises
        ------
        SessionError
            No session there and no profile given; another profile; a layout that this version does not read; a disk
            that refuses.
        SessionLocked
            Another living process works on it.
        SessionCorrupt
            Its files contradict its journal.
        """
        folder = Path(path)
        check_folder(folder, may_create=profile is not None)
        lock = SessionLock(folder)
        try:
            header, own_profile = read_or_create(folder, profile, seed)
            for leftover in folder.rglob(f"*{PART_SUFFIX}"):
                leftover.unlink()
            ledger = Ledger(folder, header, Journal(folder / JOURNAL_NAME))
            finish_profile_change(folder, header.profile.sha256)
            ledger.record_open(own_versions(), own_command())
            if own_profile.sha256 != header.profile.sha256:
                ledger.change_profile(own_profile)
        except BaseException:
            lock.release()
            raise
        return cls(folder, own_profile, ledger, lock)

    @classmethod
    def read(cls, path: str | os.PathLike[str], profile: Profile | None = None) -> Session:
        """Look into a session without owning it: nothing can be written, and another process may work on it.

        Parameters
        ----------
        path
            Its folder.
        profile
            What it has to have been made with, if given.

        Returns
        -------
        Session
            That refuses to write.

        Raises
        ------
        SessionError
            No session there; another profile; a layout that this version does not read.
        SessionCorrupt
            Its files contradict its journal.
        """
        folder = Path(path)
        check_folder(folder, may_create=False)
        header, own_profile = read_folder(folder, profile)
        return cls(folder, own_profile, Ledger(folder, header, None), None)

    @staticmethod
    def exists(path: str | os.PathLike[str]) -> bool:
        """Tell whether a folder holds a session.

        Parameters
        ----------
        path
            The folder.

        Returns
        -------
        bool
        """
        return is_session(Path(path))

    def close(self) -> None:
        """Let the folder go; any number of times."""
        self._ledger.close()
        if self._lock is not None:
            self._lock.release()

    def __enter__(self) -> Session:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def step(self, name: str, *, settings: Mapping[str, object] | None = None, needs: Sequence[str] = ()) -> Step:
        """Begin a step, or go on with it where it stopped.

        Settings and the outputs of the steps in ``needs`` are its inputs: with the same ones it goes on (or
        is ``done``), with others a new run begins whose files get new numbers.

        Parameters
        ----------
        name
            Letters, digits, ``.``, ``_`` and ``-``.
        settings
            Numbers, words, sequences and mappings of them, by name.
        needs
            Names of the steps whose results it reads.

        Returns
        -------
        Step

        Raises
        ------
        SessionError
            A needed step is not finished.
        """
        check_name(name)
        own = {key: json_of(value) for key, value in (settings or {}).items()}
        run = self._ledger.begin(name, self._hash_of_inputs(own, needs), own)
        return Step(self._ledger, run)

    def is_done(self, name: str, *, settings: Mapping[str, object], needs: Sequence[str]) -> bool:
        """Tell whether a step with these inputs would have nothing left to do; begins nothing.

        Parameters
        ----------
        name, settings, needs
            As for :meth:`step`.

        Returns
        -------
        bool
            False also when a needed step is not finished.
        """
        run = self._ledger.last_run(name)
        own = {key: json_of(value) for key, value in settings.items()}
        if run is None or not all(self.is_finished(need) for need in needs):
            return False
        if run.inputs_sha256 != self._hash_of_inputs(own, needs):
            return False
        return Step(self._ledger, run).done

    def _hash_of_inputs(self, settings: JsonObject, needs: Sequence[str]) -> str:
        return hash_json({"settings": settings, "needs": {need: self.finished(need).outputs_sha256 for need in needs}})

    def finished(self, name: str, *, verb: str = "run") -> Step:
        """Return a finished step for reading.

        Parameters
        ----------
        name
            Of the step.
        verb
            The command to recommend when it is not there.

        Returns
        -------
        Step
            Its last run.

        Raises
        ------
        SessionError
            It is missing or not finished.
        SessionCorrupt
            Its files are damaged.
        """
        run = self._ledger.last_run(name)
        if run is None or run.outputs_sha256 is None:
            state = "has not been started" if run is None else "is not finished"
            raise SessionError(f"{self.path}: step {name!r} {state}; run `rig {verb} {typed(self.path)}` first")
        step = Step(self._ledger, run)
        if step.damaged_files:
            raise SessionCorrupt(
                f"{self.path}: lost or damaged: {counted(len(step.damaged_files), 'file')} of step {name!r}, first "
                f"{step.damaged_files[0]}; run `rig {verb} {typed(self.path)}` to repeat what is missing"
            )
        return step

    def begun(self, name: str) -> Step | None:
        """Return the last run of a step for reading, finished and intact or not.

        Parameters
        ----------
        name
            Of the step.

        Returns
        -------
        Step or None
            None when it was never begun.
        """
        run = self._ledger.last_run(name)
        return None if run is None else Step(self._ledger, run)

    def is_finished(self, name: str) -> bool:
        """Tell whether the last run of a step is finished.

        Parameters
        ----------
        name
            Of the step.

        Returns
        -------
        bool
        """
        run = self._ledger.last_run(name)
        return run is not None and run.outputs_sha256 is not None

    @property
    def seed(self) -> int:
        """For every random choice in the session."""
        return self._ledger.header.seed

    @property
    def versions(self) -> Mapping[str, str]:
        """Versions of procam-rig and of the libraries that made the session, by name."""
        return self._ledger.header.versions

    @property
    def last_clock_s(self) -> float:
        """End of the frame that was photographed last, on the rig's clock; 0 when there is none."""
        return self._ledger.last_clock_s

    def files(self) -> list[tuple[str, FileEntry]]:
        """Return the files of the last run of each step, in the order in which the steps were begun.

        Returns
        -------
        list of (step, FileEntry)
            Frames, images and maps; not the records. Raises SessionCorrupt when one is lost or damaged.
        """
        return self._ledger.last_files()

    def note(self, event: Record | Mapping[str, object]) -> None:
        """Journal something worth knowing later: a rejected frame, a retry, a warning.

        Parameters
        ----------
        event
            A record, or numbers and words by name.
        """
        self._ledger.record({"event": "note", "note": json_of(event)})

    def frame_log(self) -> list[Event]:
        """Return frames and notes, in the order in which they happened.

        Returns
        -------
        list of dict
            As journalled, each with its time of day.
        """
        return [dict(event) for event in self._ledger.events if event["event"] in ("frame", "note")]

    @property
    def commands(self) -> list[str]:
        """Commands, as typed, that opened the session to write, in order, none twice in a row."""
        typed = [event["command"] for event in self._ledger.events if event["event"] == "open" and "command" in event]
        return [command for k, command in enumerate(typed) if k == 0 or typed[k - 1] != command]

    def events(self) -> list[Event]:
        """Return everything that the journal says, in order.

        Returns
        -------
        list of dict
            As journalled, each with its time of day.
        """
        return [dict(event) for event in self._ledger.events]

    def read_metrics(self, kind: type[Kind]) -> Kind:
        """Return what metrics.json holds, as a record of a kind.

        Parameters
        ----------
        kind
            ``SessionResult`` of a session that was compared, else ``PartialResult``.

        Returns
        -------
        Record
            Of that kind.

        Raises
        ------
        SessionError
            The session was not compared yet; or the file is missing, cannot be read, or lacks what the kind has.
        SessionCorrupt
            It was changed since it was written.
        """
        self._ledger.check_metrics()
        try:
            return read_record(kind, json.loads((self.path / METRICS_NAME).read_bytes()))
        except (OSError, ValueError, RecursionError) as error:
            self._ledger.refuse_metrics(error)

    def write_metrics(self, metrics: Record | Mapping[str, object]) -> Path:
        """Write metrics.json. Raises ValueError for NaN and infinities.

        Parameters
        ----------
        metrics
            What was measured.

        Returns
        -------
        Path
            Of the file.
        """
        return self._ledger.write_metrics(json_of(metrics))

    def write_report(self, html: str) -> Path:
        """Write report.html.

        Parameters
        ----------
        html
            The whole page.

        Returns
        -------
        Path
            Of the file.
        """
        write_bytes(self.path / "report.html", html.encode())
        return self.path / "report.html"
