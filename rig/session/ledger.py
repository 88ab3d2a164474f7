"""What a session's journal says: runs of steps and the files that they wrote."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

from rig.files.atomic import sha256_of, write_bytes
from rig.files.journal import JOURNAL_NAME, Event, Journal, corrupt_line

FileKind = Literal["frame", "image", "record"]


@dataclass(frozen=True, slots=True)
class FrameDetails:
    """What a frame's file does not hold: its pattern and its times on the rig's clock."""

    pattern: str
    exposure_s: float
    started_s: float
    sequence: int
    signature: str = ""
    """Of the codes that were shown (:func:`rig.devices.protocols.signature_of`); empty when not known."""


@dataclass(frozen=True, slots=True)
class FileEntry:
    """A file that was completely written, as the journal has it."""

    kind: FileKind
    name: str
    file: str
    """Path inside the session, with forward slashes."""
    size_bytes: int
    sha256: str
    frame: FrameDetails | None = None


@dataclass(slots=True)
class Run:
    """One run of a step over one set of inputs."""

    step: str
    number: int
    inputs_sha256: str
    settings: dict[str, Any]
    files: dict[tuple[FileKind, str], FileEntry] = field(default_factory=dict)
    outputs_sha256: str | None = None
    """Set when finished."""

    def hash_outputs(self) -> str:
        """Hash of what was written, whatever the files are called and whenever they were made."""
        return hash_json(
            sorted([e.kind, e.name, e.sha256, e.frame.exposure_s if e.frame else 0.0] for e in self.files.values())
        )


def hash_json(value: Any) -> str:
    """SHA-256 of a JSON value, independent of the order of keys."""
    text = json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


class Ledger:
    """The journal and what follows from it; every change goes through :meth:`record`, to the disk first."""

    def __init__(self, folder: Path, header: Mapping[str, Any]):
        self.folder = folder
        self.header = dict(header)
        self.journal = Journal(folder / JOURNAL_NAME)
        self.events: list[Event] = []
        self.runs: dict[str, list[Run]] = {}
        for number, event in enumerate(self.journal.events(), start=1):
            try:
                self._apply(event)
            except (KeyError, TypeError, IndexError) as error:
                raise corrupt_line(self.journal.path, number) from error

    def record(self, event: Mapping[str, Any]) -> None:
        """Journal an event and take it into account; raises SessionError when the disk refuses."""
        self._apply(self.journal.append(event))

    def _apply(self, event: Event) -> None:
        kind = event["event"]
        if kind == "begin":
            runs = self.runs.setdefault(event["step"], [])
            runs.append(Run(event["step"], event["run"], event["inputs_sha256"], event["settings"]))
        elif kind in ("frame", "image", "record"):
            frame = FrameDetails(**event["frame"]) if kind == "frame" else None
            entry = FileEntry(kind, event["name"], event["file"], event["size_bytes"], event["sha256"], frame)
            run = self.runs[event["step"]][-1]
            run.files[kind, entry.name] = entry
            run.outputs_sha256 = None
        elif kind == "finish":
            self.runs[event["step"]][-1].outputs_sha256 = event["outputs_sha256"]
        self.events.append(event)

    def begin(self, step: str, inputs_sha256: str, settings: Mapping[str, Any]) -> Run:
        """Go on with the step's last run when its inputs are the same, else begin a new one."""
        runs = self.runs.get(step, [])
        if not runs or runs[-1].inputs_sha256 != inputs_sha256:
            self.record(
                {
                    "event": "begin",
                    "step": step,
                    "run": len(runs) + 1,
                    "inputs_sha256": inputs_sha256,
                    "settings": dict(settings),
                }
            )
            self.write_summary()
        return self.runs[step][-1]

    def add_file(self, run: Run, kind: FileKind, name: str, path: Path, frame: FrameDetails | None = None) -> None:
        """Journal a file that is on the disk, unless the journal has it with the same bytes."""
        file, sha256 = path.relative_to(self.folder).as_posix(), sha256_of(path)
        if run.files.get((kind, name)) == FileEntry(kind, name, file, path.stat().st_size, sha256, frame):
            return
        event = {
            "event": kind,
            "step": run.step,
            "name": name,
            "file": file,
            "size_bytes": path.stat().st_size,
            "sha256": sha256,
        }
        self.record(event if frame is None else {**event, "frame": asdict(frame)})

    def finish(self, run: Run) -> None:
        """Journal the end of a run, and bring session.json up to date."""
        self.record({"event": "finish", "step": run.step, "outputs_sha256": run.hash_outputs()})
        self.write_summary()

    def files_like(self, prefix: str) -> int:
        """How many different journalled files begin with a path."""
        entries = (entry for runs in self.runs.values() for run in runs for entry in run.files.values())
        return len({entry.file for entry in entries if entry.file.startswith(prefix)})

    def is_intact(self, entry: FileEntry, *, verify: bool) -> bool:
        """Whether the file is there in its journalled size and, on ``verify``, with its bytes."""
        path = self.folder / entry.file
        if not path.is_file() or path.stat().st_size != entry.size_bytes:
            return False
        return not verify or sha256_of(path) == entry.sha256

    def write_summary(self) -> None:
        """Rewrite session.json, which says in short what the journal says."""
        steps = {name: _summary(runs[-1]) for name, runs in sorted(self.runs.items())}
        write_json(self.folder / "session.json", {**self.header, "steps": steps})


def _summary(run: Run) -> dict[str, Any]:
    return {
        "run": run.number,
        "state": "begun" if run.outputs_sha256 is None else "finished",
        "inputs_sha256": run.inputs_sha256,
        "outputs_sha256": run.outputs_sha256,
        "settings": run.settings,
    }


def write_json(path: Path, value: Any) -> None:
    """Write a JSON file as a whole; numbers come back exactly. Raises ValueError for NaN, SessionError."""
    write_bytes(path, json.dumps(value, indent=1, allow_nan=False).encode() + b"\n")
