"""What a session's journal says: runs of steps and the files that they wrote."""

from __future__ import annotations

import hashlib
import json
import os
import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal, NoReturn

from rig.errors import SessionCorrupt, SessionError
from rig.files.atomic import sha256_of, write_bytes
from rig.files.journal import JOURNAL_NAME, Event, Journal, corrupt_line, read_events
from rig.profile.schema import Profile
from rig.records import Json, JsonObject, Record
from rig.session.folder import NEXT_PROFILE, finish_profile_change, typed
from rig.session.header import ProfileStamp, SessionHeader

METRICS_NAME = "metrics.json"
_COMPARISON = "compare"
"""Name of the step after which metrics.json is that of a comparison."""
_SETTLED_S = 1.0
"""A file that was written later than that may change without a change of its time, whose steps are coarse."""

_HASHED: dict[tuple[str, int, int, int], str] = {}
"""SHA-256 of files by path, inode, size and time of change: each is read once a process for it."""

FileKind = Literal["frame", "image", "record"]


@dataclass(frozen=True, kw_only=True)
class FrameDetails(Record):
    """What a frame's file does not hold: which devices made it, its pattern, and its times on the rig's clock."""

    camera: str = ""
    """Name of the camera that took it; empty when not known."""
    projector: str = ""
    """Name of the projector that showed the pattern, while all others were black; empty when not known."""
    pattern: str
    exposure_s: float
    started_s: float
    sequence: int
    signature: str = ""
    """Of the codes that were shown (:func:`rig.devices.protocols.signature_of`); empty when not known."""
    codes_sha256: str | None = None
    """Of the codes that were shown, every one of them; None when not known."""
    asked_s: float | None = None
    """Exposure that was asked for; None when not known."""

    @property
    def shown_as(self) -> tuple[str | None, str, str, float | None]:
        """What makes two photographs photographs of the same: codes, devices and the exposure that was asked for."""
        return self.codes_sha256, self.camera, self.projector, self.asked_s


@dataclass(frozen=True, slots=True, kw_only=True)
class FileEntry:
    """A file that was completely written, as the journal has it."""

    kind: FileKind
    name: str
    file: str
    """Path inside the session, with forward slashes."""
    size_bytes: int
    sha256: str
    frame: FrameDetails | None = None


@dataclass(slots=True, kw_only=True)
class StepRun:
    """One run of a step over one set of inputs."""

    step: str
    number: int
    inputs_sha256: str
    settings: JsonObject
    files: dict[tuple[FileKind, str], FileEntry] = field(default_factory=dict)
    outputs_sha256: str | None = None
    """Set when finished."""

    def hash_outputs(self) -> str:
        """Return the hash of what was written, whatever the files are called and whenever they were made."""
        files = self.files.values()
        written = sorted((e.kind, e.name, e.sha256, e.frame.exposure_s if e.frame else 0.0) for e in files)
        return hash_json([list(file) for file in written])


def hash_json(value: Json) -> str:
    """Return the SHA-256 of a JSON value, independent of the order of keys."""
    text = json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


class Ledger:
    """The journal and what follows from it; every change goes through :meth:`record`, to the disk first.

    Parameters
    ----------
    folder
        The session's.
    header
        What session.json begins with.
    journal
        Open for writing; None to read alone, while another process may be writing.
    """

    def __init__(self, folder: Path, header: SessionHeader, journal: Journal | None):
        self.folder = folder
        self.header = header
        self.events: list[Event] = []
        self.runs: dict[str, list[StepRun]] = {}
        self._journal = journal
        path = folder / JOURNAL_NAME
        for number, event in enumerate(read_events(path), start=1):
            try:
                self._apply(event)
            except (KeyError, TypeError, IndexError) as error:
                raise corrupt_line(path, number) from error
        self._check_header()

    def _check_header(self) -> None:
        """Raise SessionCorrupt when session.json is not the one with which the session was begun."""
        known = [event for event in self.events if "header_sha256" in event]
        # The change of a profile is journalled first: a process that was killed then has left the header before it.
        current = known[-2:] if known and known[-1]["event"] == "profile" else known[-1:]
        if known and hash_json(self.header.as_json()) not in {event["header_sha256"] for event in current}:
            raise SessionCorrupt(
                f"{self.folder / 'session.json'}: was changed; restore it from a copy, or start a new session"
            )

    def close(self) -> None:
        """Let the journal go; any number of times."""
        if self._journal is not None:
            self._journal.close()

    def record(self, event: Mapping[str, Json]) -> None:
        """Journal an event and take it into account; raises SessionError when the disk refuses."""
        if self._journal is None:
            raise SessionError(f"{self.folder}: was opened to read; open it with Session.open to write")
        self._apply(self._journal.append(event))

    def _apply(self, event: Event) -> None:
        kind = event["event"]
        if kind == "begin":
            runs = self.runs.setdefault(event["step"], [])
            runs.append(
                StepRun(
                    step=event["step"],
                    number=event["run"],
                    inputs_sha256=event["inputs_sha256"],
                    settings=event["settings"],
                )
            )
        elif kind in ("frame", "image", "record"):
            frame = FrameDetails(**event["frame"]) if kind == "frame" else None
            entry = FileEntry(
                kind=kind,
                name=event["name"],
                file=event["file"],
                size_bytes=event["size_bytes"],
                sha256=event["sha256"],
                frame=frame,
            )
            run = self.runs[event["step"]][-1]
            run.files[kind, entry.name] = entry
            run.outputs_sha256 = None
        elif kind == "finish":
            self.runs[event["step"]][-1].outputs_sha256 = event["outputs_sha256"]
        self.events.append(event)

    @property
    def last_clock_s(self) -> float:
        """End of the frame that was photographed last, on the rig's clock; 0 when there is none."""
        # A file is journalled again by a run that takes an earlier frame over: that is not when it was photographed.
        frames: dict[str, Event] = {}
        for event in self.events:
            if event["event"] == "frame":
                frames.setdefault(event["file"], event["frame"])
        last = next(reversed(frames.values()), None)
        return 0.0 if last is None else float(last["started_s"] + last["exposure_s"])

    def last_files(self) -> list[tuple[str, FileEntry]]:
        """Return (step, file) of the last runs but for records, in the order of the steps. Raises SessionCorrupt."""
        found = [(name, entry) for name, runs in self.runs.items() for entry in runs[-1].files.values()]
        for name, entry in found:
            if not self.is_intact(entry):
                raise SessionCorrupt(
                    f"{self.folder / entry.file}: is missing, or not as step {name!r} wrote it; run "
                    f"`rig run {typed(self.folder)}`, which makes it anew"
                )
        return [(name, entry) for name, entry in found if entry.kind != "record"]

    def last_run(self, step: str) -> StepRun | None:
        """Return the last run of a step; None when it was never begun."""
        runs = self.runs.get(step)
        return runs[-1] if runs else None

    def begin(self, step: str, inputs_sha256: str, settings: JsonObject) -> StepRun:
        """Go on with the step's last run when its inputs are the same, else begin a new one."""
        last = self.last_run(step)
        if last is None or last.inputs_sha256 != inputs_sha256:
            number = 1 if last is None else last.number + 1
            self.record(
                {"event": "begin", "step": step, "run": number, "inputs_sha256": inputs_sha256, "settings": settings}
            )
            self.write_summary()
        return self.runs[step][-1]

    def earlier_frames(self, run: StepRun) -> list[FileEntry]:
        """Return the intact frames of the earlier runs of a run's step that it has not taken over, oldest first."""
        taken = {entry.file for entry in run.files.values()}
        entries = [entry for one in self.runs[run.step] if one is not run for entry in one.files.values()]
        left = {entry.file: entry for entry in entries if entry.frame is not None and entry.file not in taken}
        return [entry for entry in left.values() if self.is_intact(entry)]

    def add_file(self, run: StepRun, entry: FileEntry) -> None:
        """Journal a file that is on the disk, unless the journal has it with the same bytes."""
        if run.files.get((entry.kind, entry.name)) == entry:
            return
        event: JsonObject = {
            "event": entry.kind,
            "step": run.step,
            "name": entry.name,
            "file": entry.file,
            "size_bytes": entry.size_bytes,
            "sha256": entry.sha256,
        }
        self.record(event if entry.frame is None else {**event, "frame": entry.frame.as_json()})

    def entry_of(self, kind: FileKind, name: str, path: Path, frame: FrameDetails | None = None) -> FileEntry:
        """Return the entry of a file that is on the disk."""
        return FileEntry(
            kind=kind,
            name=name,
            file=path.relative_to(self.folder).as_posix(),
            size_bytes=path.stat().st_size,
            sha256=sha256_of(path),
            frame=frame,
        )

    def finish(self, run: StepRun) -> None:
        """Journal the end of a run, and bring session.json up to date."""
        self.record({"event": "finish", "step": run.step, "outputs_sha256": run.hash_outputs()})
        self.write_summary()

    def files_like(self, prefix: str) -> int:
        """Return how many different journalled files begin with a path."""
        entries = (entry for runs in self.runs.values() for run in runs for entry in run.files.values())
        return len({entry.file for entry in entries if entry.file.startswith(prefix)})

    def record_open(self, versions: Mapping[str, str], command: str) -> None:
        """Journal that this process works on the session, with its libraries' versions and its command, if any."""
        header = hash_json(self.header.as_json())
        # Before the line that holds its hash: killed between both, a process leaves a session and no contradiction.
        self.write_summary()
        known: JsonObject = {"pid": os.getpid(), "versions": dict(versions), "header_sha256": header}
        self.record({"event": "open", **known, **({"command": command} if command else {})})

    def change_profile(self, profile: Profile) -> None:
        """Take another profile over, whichever moment the process may be killed at. Raises SessionError."""
        stamp = ProfileStamp(name=profile.name, sha256=profile.sha256, source=str(profile.path))
        header = replace(self.header, profile=stamp)
        write_bytes(self.folder / NEXT_PROFILE, profile.raw)
        self.record({"event": "profile", "sha256": profile.sha256, "header_sha256": hash_json(header.as_json())})
        self.header = header
        self.write_summary()
        finish_profile_change(self.folder, profile.sha256)

    def is_intact(self, entry: FileEntry) -> bool:
        """Tell whether the file is there with its journalled bytes."""
        path = self.folder / entry.file
        if not path.is_file() or path.stat().st_size != entry.size_bytes:
            return False
        return self._sha256_of(path) == entry.sha256

    def _sha256_of(self, path: Path) -> str:
        """Return a file's SHA-256; computed again when the file may have been written to. Raises SessionError."""
        try:
            status = path.stat()
            key = (str(path), status.st_ino, status.st_size, status.st_mtime_ns)
            if key not in _HASHED or time.time() - status.st_mtime < _SETTLED_S:
                _HASHED[key] = sha256_of(path)
        except OSError as error:
            raise SessionError(
                f"{path}: cannot be read: {error.strerror}; check the file, then run the same command again"
            ) from error
        return _HASHED[key]

    def write_metrics(self, metrics: Json) -> Path:
        """Write metrics.json, and journal what it holds."""
        path = self.folder / METRICS_NAME
        write_json(path, metrics)
        self.record({"event": "metrics", "sha256": self._sha256_of(path)})
        return path

    def check_metrics(self) -> None:
        """Raise SessionCorrupt when metrics.json is there and not as it was last written."""
        path = self.folder / METRICS_NAME
        written = next((event["sha256"] for event in reversed(self.events) if event["event"] == "metrics"), None)
        if written is not None and path.is_file() and self._sha256_of(path) != written:
            raise SessionCorrupt(
                f"{path}: is not what was written there; run `rig run {typed(self.folder)}`, which writes it anew"
            )

    def refuse_metrics(self, error: Exception) -> NoReturn:
        """Raise SessionError with why metrics.json gave no record of a comparison; `error` came of reading it."""
        path, again = self.folder / METRICS_NAME, f"run `rig run {typed(self.folder)}`"
        if all(run.outputs_sha256 is None for run in self.runs.get(_COMPARISON, ())):
            raise SessionError(f"{self.folder}: nothing was compared yet; {again} first") from error
        if isinstance(error, FileNotFoundError):
            raise SessionError(f"{path}: is missing; {again}, which writes it anew") from error
        if isinstance(error, OSError):
            raise SessionError(f"{path}: cannot be read: {error.strerror}; put that right, then {again}") from error
        raise SessionError(f"{path}: is not as this version writes it: {error}; {again}, which does") from error

    def write_summary(self) -> None:
        """Rewrite session.json, which says in short what the journal says."""
        steps: JsonObject = {name: _summary(runs[-1]) for name, runs in sorted(self.runs.items())}
        write_json(self.folder / "session.json", {**self.header.as_json(), "steps": steps})


def _summary(run: StepRun) -> JsonObject:
    return {
        "run": run.number,
        "state": "begun" if run.outputs_sha256 is None else "finished",
        "inputs_sha256": run.inputs_sha256,
        "outputs_sha256": run.outputs_sha256,
        "settings": run.settings,
    }


def write_json(path: Path, value: Json) -> None:
    """Write a JSON file as a whole; numbers come back exactly. Raises ValueError for NaN, SessionError."""
    write_bytes(path, json.dumps(value, indent=1, allow_nan=False).encode() + b"\n")
