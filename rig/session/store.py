"""The session: a folder with all that a run of the rig has seen and found; it survives being killed."""

from __future__ import annotations

import hashlib
import json
import os
import platform
import socket
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import TypeVar

import cv2
import numpy as np
import OpenImageIO as oiio  # noqa: N813 - the library's own documentation calls it so
import scipy

from rig.errors import SessionCorrupt, SessionError
from rig.files.atomic import PART_SUFFIX, session_error, write_bytes
from rig.files.journal import JOURNAL_NAME, Event, Journal
from rig.profile.schema import Profile
from rig.records import JsonObject, Record, json_of, read_record
from rig.session.header import SCHEMA, ProfileStamp, SessionHeader, read_header
from rig.session.ledger import Ledger, hash_json, write_json
from rig.session.lock import SessionLock
from rig.session.step import Step, check_name
from rig.version import __version__

Kind = TypeVar("Kind")

_OWN_NAMES = {"lock", "profile.toml", "session.json", JOURNAL_NAME}


class Session:
    """A session's folder, open for one process; use it in a ``with`` statement."""

    def __init__(self, folder: Path, profile: Profile, ledger: Ledger, lock: SessionLock | None, *, verify: bool):
        self.path = folder
        self.profile = profile
        self._ledger = ledger
        self._lock = lock
        self._verify = verify

    @classmethod
    def open(
        cls,
        path: str | os.PathLike[str],
        profile: Profile | None = None,
        *,
        seed: int = 1,
        verify: bool = False,
    ) -> Session:
        """Open a session, or make one when a profile is given and there is none.

        Parameters
        ----------
        path
            Its folder.
        profile
            Needed for a new session; has to be the same one later (or left out).
        seed
            Of a new session, for every random choice in it.
        verify
            Compare every file that is read with its journalled hash, not only its size.

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
        _check_folder(folder, may_create=profile is not None)
        lock = SessionLock(folder)
        try:
            header, own_profile = _read_or_create(folder, profile, seed)
            for leftover in folder.rglob(f"*{PART_SUFFIX}"):
                leftover.unlink()
            ledger = Ledger(folder, header, Journal(folder / JOURNAL_NAME))
            ledger.record({"event": "open", "pid": os.getpid(), "versions": json_of(_versions())})
            ledger.write_summary()
        except BaseException:
            lock.release()
            raise
        return cls(folder, own_profile, ledger, lock, verify=verify)

    @classmethod
    def read(cls, path: str | os.PathLike[str], profile: Profile | None = None) -> Session:
        """Look into a session without owning it: nothing can be written, and another process may work on it.

        Parameters
        ----------
        path
            Its folder.
        profile
            What it has to have been made with, if given.

        Raises
        ------
        SessionError
            No session there; another profile; a layout that this version does not read.
        SessionCorrupt
            Its files contradict its journal.
        """
        folder = Path(path)
        _check_folder(folder, may_create=False)
        header, own_profile = _read(folder, profile)
        return cls(folder, own_profile, Ledger(folder, header, None), None, verify=False)

    @staticmethod
    def exists(path: str | os.PathLike[str]) -> bool:
        """Tell whether a folder holds a session."""
        return (Path(path) / "session.json").is_file()

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

        Raises
        ------
        SessionError
            A needed step is not finished.
        """
        check_name(name)
        own = {key: json_of(value) for key, value in (settings or {}).items()}
        run = self._ledger.begin(name, self._hash_of_inputs(own, needs), own)
        return Step(self._ledger, run, verify=self._verify)

    def is_done(self, name: str, *, settings: Mapping[str, object], needs: Sequence[str]) -> bool:
        """Tell whether a step with these inputs would have nothing left to do; begins nothing."""
        run = self._ledger.last_run(name)
        own = {key: json_of(value) for key, value in settings.items()}
        if run is None or not all(self.is_finished(need) for need in needs):
            return False
        if run.inputs_sha256 != self._hash_of_inputs(own, needs):
            return False
        return Step(self._ledger, run, verify=self._verify).done

    def _hash_of_inputs(self, settings: JsonObject, needs: Sequence[str]) -> str:
        return hash_json({"settings": settings, "needs": {need: self.finished(need).outputs_sha256 for need in needs}})

    def finished(self, name: str, *, verb: str = "run") -> Step:
        """Return a finished step for reading; ``verb`` is the command to recommend when it is not there.

        Raises SessionError when it is missing or not finished, SessionCorrupt when its files are damaged.
        """
        run = self._ledger.last_run(name)
        if run is None or run.outputs_sha256 is None:
            state = "has not been started" if run is None else "is not finished"
            raise SessionError(f"{self.path}: step {name!r} {state}; run `rig {verb} {self.path}` first")
        step = Step(self._ledger, run, verify=self._verify)
        if step.damaged_files:
            raise SessionCorrupt(
                f"{self.path}: {len(step.damaged_files)} files of step {name!r} are lost or damaged, first "
                f"{step.damaged_files[0]}; run `rig {verb} {self.path}` to repeat what is missing"
            )
        return step

    def is_finished(self, name: str) -> bool:
        """Tell whether the last run of a step is finished."""
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
        """End of the last journalled frame on the rig's clock; 0 when there is none."""
        frames = [event["frame"] for event in self._ledger.events if event["event"] == "frame"]
        return float(frames[-1]["started_s"] + frames[-1]["exposure_s"]) if frames else 0.0

    def note(self, event: Record | Mapping[str, object]) -> None:
        """Journal something worth knowing later: a rejected frame, a retry, a warning."""
        self._ledger.record({"event": "note", "note": json_of(event)})

    def frame_log(self) -> list[Event]:
        """Frames and notes, in the order in which they happened, as journalled."""
        return [dict(event) for event in self._ledger.events if event["event"] in ("frame", "note")]

    def events(self) -> list[Event]:
        """Everything that the journal says, in order, each with its time of day."""
        return [dict(event) for event in self._ledger.events]

    def read_metrics(self, kind: type[Kind]) -> Kind:
        """Return what metrics.json holds, as a record of a kind.

        Raises SessionError when there is none, or it lacks what the kind has: the session was not compared yet.
        """
        try:
            return read_record(kind, json.loads((self.path / "metrics.json").read_bytes()))
        except (OSError, ValueError) as error:
            raise SessionError(f"{self.path}: nothing was compared yet; run `rig run {self.path}` first") from error

    def write_metrics(self, metrics: Record | Mapping[str, object]) -> Path:
        """Write metrics.json. Raises ValueError for NaN and infinities."""
        write_json(self.path / "metrics.json", json_of(metrics))
        return self.path / "metrics.json"

    def write_report(self, html: str) -> Path:
        """Write report.html."""
        write_bytes(self.path / "report.html", html.encode())
        return self.path / "report.html"


def _check_folder(folder: Path, *, may_create: bool) -> None:
    """Make the folder of a new session; refuse what is neither a session nor empty."""
    if folder.exists() and not folder.is_dir():
        raise SessionError(f"{folder}: is a file; a session is a folder, give another name")
    if (folder / "session.json").is_file():
        return
    if not may_create:
        raise SessionError(f"{folder}: no session; make one with `rig run {folder} -p PROFILE --target IMAGE`")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        foreign = sorted(p.name for p in folder.iterdir() if p.name.removesuffix(PART_SUFFIX) not in _OWN_NAMES)
    except OSError as error:
        raise session_error(error, folder) from error
    if foreign:
        raise SessionError(f"{folder}: has other files ({foreign[0]}, ...); give a new or an empty folder")


def _read_or_create(folder: Path, profile: Profile | None, seed: int) -> tuple[SessionHeader, Profile]:
    if Session.exists(folder) or profile is None:
        return _read(folder, profile)
    write_bytes(folder / "profile.toml", profile.raw)
    created = datetime.now(UTC).isoformat(timespec="seconds")
    header = SessionHeader(
        schema=SCHEMA,
        seed=seed,
        versions=_versions(),
        profile=ProfileStamp(name=profile.name, sha256=profile.sha256, source=str(profile.path)),
        volatile={"created": created, "host": socket.gethostname()},
    )
    return header, profile


def _read(folder: Path, profile: Profile | None) -> tuple[SessionHeader, Profile]:
    """Read the header and the session's profile: the one that is handed in, if it is the same, else the copy."""
    header = read_header(folder / "session.json")
    made_with = header.profile
    if profile is not None and profile.sha256 != made_with.sha256:
        raise SessionError(
            f"{folder}: was made with profile {made_with.name!r} ({made_with.sha256[:12]}), not {profile.name!r} "
            f"({profile.sha256[:12]}); leave the profile out, or give a new folder"
        )
    copy = _read_copy(folder, made_with.sha256)
    return header, profile or Profile.parse(copy, Path(made_with.source))


def _read_copy(folder: Path, sha256: str) -> bytes:
    """Return the exact bytes of the session's profile; its paths are relative to where the original lies."""
    try:
        raw = (folder / "profile.toml").read_bytes()
    except OSError as error:
        raise SessionCorrupt(f"{folder / 'profile.toml'}: cannot be read: {error.strerror}; restore it") from error
    if hashlib.sha256(raw).hexdigest() != sha256:
        raise SessionCorrupt(f"{folder / 'profile.toml'}: was changed; restore it, or start a new session")
    return raw


def _versions() -> dict[str, str]:
    modules = {"numpy": np, "scipy": scipy, "opencv": cv2, "OpenImageIO": oiio}
    own = {"procam-rig": __version__, "python": platform.python_version()}
    return own | {name: str(module.__version__) for name, module in modules.items()}
