"""The session: a folder with all that a run of the rig has seen and found; it survives being killed."""

from __future__ import annotations

import json
import os
import platform
import socket
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Any

import cv2
import numpy as np
import OpenImageIO as oiio  # noqa: N813 - the library's own documentation calls it so
import scipy

from rig.errors import SessionCorrupt, SessionError
from rig.files.atomic import PART_SUFFIX, session_error, write_bytes
from rig.files.journal import JOURNAL_NAME, Event
from rig.profile.schema import Profile
from rig.session.ledger import Ledger, hash_json, write_json
from rig.session.lock import SessionLock
from rig.session.step import Step, check_name, plain

SCHEMA = 1
"""The newest layout of a session that this version reads."""

_OWN_NAMES = {"lock", "profile.toml", "session.json", JOURNAL_NAME}


class Session:
    """A session's folder, open for one process; use it in a ``with`` statement."""

    def __init__(self, folder: Path, profile: Profile, ledger: Ledger, lock: SessionLock, *, verify: bool):
        self.path = folder
        self.profile = profile
        self.seed: int = ledger.header["seed"]
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

        Raises
        ------
        SessionError
            No session there and no profile given; another profile; a newer layout; a disk that refuses.
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
            ledger = Ledger(folder, header)
            ledger.record({"event": "open", "pid": os.getpid(), "versions": _versions()})
            ledger.write_summary()
        except BaseException:
            lock.release()
            raise
        return cls(folder, own_profile, ledger, lock, verify=verify)

    def close(self) -> None:
        """Let the folder go; any number of times."""
        self._ledger.journal.close()
        self._lock.release()

    def __enter__(self) -> Session:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def step(self, name: str, *, settings: Mapping[str, Any] | None = None, needs: Sequence[str] = ()) -> Step:
        """Begin a step, or go on with it where it stopped.

        Settings and the outputs of the steps in ``needs`` are its inputs: with the same ones it goes on (or
        is ``done``), with others a new run begins whose files get new numbers. Raises SessionError when a
        needed step is not finished.
        """
        check_name(name)
        own = plain(settings or {})
        inputs = {"settings": own, "needs": {need: self.finished(need).outputs_sha256 for need in needs}}
        run = self._ledger.begin(name, hash_json(inputs), own)
        return Step(self._ledger, run, verify=self._verify)

    def finished(self, name: str, *, verb: str = "run") -> Step:
        """Return a finished step for reading; ``verb`` is the command to recommend when it is not there.

        Raises SessionError when it is missing or not finished, SessionCorrupt when its files are damaged.
        """
        runs = self._ledger.runs.get(name)
        if not runs or runs[-1].outputs_sha256 is None:
            state = "has not been started" if not runs else "is not finished"
            raise SessionError(f"{self.path}: step {name!r} {state}; run `rig {verb} {self.path}` first")
        step = Step(self._ledger, runs[-1], verify=self._verify)
        if step.damaged_files:
            raise SessionCorrupt(
                f"{self.path}: {len(step.damaged_files)} files of step {name!r} are lost or damaged, first "
                f"{step.damaged_files[0]}; run `rig {verb} {self.path}` to repeat what is missing"
            )
        return step

    def is_finished(self, name: str) -> bool:
        """Whether the last run of a step is finished."""
        runs = self._ledger.runs.get(name, [])
        return bool(runs) and runs[-1].outputs_sha256 is not None

    @property
    def last_clock_s(self) -> float:
        """End of the last journalled frame on the rig's clock; 0 when there is none."""
        frames = [event["frame"] for event in self._ledger.events if event["event"] == "frame"]
        return float(frames[-1]["started_s"] + frames[-1]["exposure_s"]) if frames else 0.0

    def note(self, event: Mapping[str, Any]) -> None:
        """Journal something worth knowing later: a rejected frame, a retry, a warning."""
        self._ledger.record({"event": "note", "note": plain(event)})

    def frame_log(self) -> list[Event]:
        """Frames and notes, in the order in which they happened, as journalled."""
        return [dict(event) for event in self._ledger.events if event["event"] in ("frame", "note")]

    def events(self) -> list[Event]:
        """Everything that the journal says, in order, each with its time of day."""
        return [dict(event) for event in self._ledger.events]

    def read_metrics(self) -> dict[str, Any]:
        """Return what metrics.json holds. Raises SessionError when the session was not compared yet."""
        try:
            metrics: dict[str, Any] = json.loads((self.path / "metrics.json").read_bytes())
        except (OSError, ValueError) as error:
            raise SessionError(f"{self.path}: no metrics yet; run `rig run {self.path}` first") from error
        return metrics

    def write_metrics(self, metrics: Mapping[str, Any]) -> Path:
        """Write metrics.json. Raises ValueError for NaN and infinities."""
        write_json(self.path / "metrics.json", plain(metrics))
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


def _read_or_create(folder: Path, profile: Profile | None, seed: int) -> tuple[dict[str, Any], Profile]:
    if not (folder / "session.json").is_file():
        if profile is None:
            raise SessionError(f"{folder}: no session; make one with `rig run {folder} -p PROFILE --target IMAGE`")
        return _create(folder, profile, seed), profile
    header = _read_header(folder / "session.json")
    own = _read_profile(folder, header)
    if profile is not None and profile.sha256 != own.sha256:
        raise SessionError(
            f"{folder}: was made with profile {own.name!r} ({own.sha256[:12]}), not {profile.name!r} "
            f"({profile.sha256[:12]}); leave the profile out, or give a new folder"
        )
    return header, own


def _create(folder: Path, profile: Profile, seed: int) -> dict[str, Any]:
    write_bytes(folder / "profile.toml", profile.raw)
    created = datetime.now(UTC).isoformat(timespec="seconds")
    return {
        "schema": SCHEMA,
        "seed": seed,
        "versions": _versions(),
        "profile": {"name": profile.name, "sha256": profile.sha256, "source": str(profile.path)},
        "volatile": {"created": created, "host": socket.gethostname()},
    }


def _versions() -> dict[str, str]:
    modules = {"numpy": np, "scipy": scipy, "opencv": cv2, "OpenImageIO": oiio}
    return {"python": platform.python_version()} | {name: str(m.__version__) for name, m in modules.items()}


def _read_header(path: Path) -> dict[str, Any]:
    try:
        header: dict[str, Any] = json.loads(path.read_bytes())
        schema, seed, sha256 = header["schema"], header["seed"], header["profile"]["sha256"]
    except (ValueError, KeyError, TypeError) as error:
        raise SessionCorrupt(f"{path}: is damaged; restore it from a copy, or start a new session") from error
    if schema > SCHEMA:
        raise SessionError(
            f"{path}: layout {schema} is newer than {SCHEMA}, the newest that this version reads; update procam-rig"
        )
    if not isinstance(seed, int) or not isinstance(sha256, str):
        raise SessionCorrupt(f"{path}: is damaged; restore it from a copy, or start a new session")
    return header


def _read_profile(folder: Path, header: Mapping[str, Any]) -> Profile:
    """Parse the session's copy; paths in it stay relative to where the original lies."""
    try:
        raw = (folder / "profile.toml").read_bytes()
    except OSError as error:
        raise SessionCorrupt(f"{folder / 'profile.toml'}: cannot be read: {error.strerror}; restore it") from error
    profile = Profile.parse(raw, Path(header["profile"]["source"]))
    if profile.sha256 != header["profile"]["sha256"]:
        raise SessionCorrupt(f"{folder / 'profile.toml'}: was changed; restore it, or start a new session")
    return profile
