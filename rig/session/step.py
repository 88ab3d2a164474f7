"""A step of a session: what it wrote can be read back, what is missing can be written."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from rig.devices.protocols import Codes, RawFrame, signature_of
from rig.errors import SessionCorrupt, SessionError
from rig.files.atomic import write_bytes
from rig.files.exr import read_exr, write_exr
from rig.records import JsonObject, Record, json_of, read_record
from rig.session.folder import typed
from rig.session.ledger import FileEntry, FileKind, FrameDetails, Ledger, StepRun, write_json

Kind = TypeVar("Kind")

_SAFE_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")
_CHANNELS = {1: ("Y",), 3: ("R", "G", "B")}


def check_name(name: str) -> None:
    """Raise ValueError unless a name can be part of a file's."""
    if not _SAFE_NAME.fullmatch(name):
        raise ValueError(f"{name!r}: names are letters, digits, '.', '_' and '-'")


class Step:
    """One run of a step; made by :meth:`Session.step` (to write) and :meth:`Session.finished` (to read).

    Parameters
    ----------
    ledger
        Of the session.
    run
        What the journal says of this run.
    """

    def __init__(self, ledger: Ledger, run: StepRun):
        self._ledger = ledger
        self._run = run
        self._is_writing = False
        """Set by the first write: a step that makes lost files anew may write the others again, too."""

    @property
    def name(self) -> str:
        """The step's name."""
        return self._run.step

    @property
    def run_number(self) -> int:
        """1 for the first inputs, 2 after these have changed, ..."""
        return self._run.number

    @property
    def settings(self) -> JsonObject:
        """What the run was begun with."""
        return dict(self._run.settings)

    @property
    def outputs_sha256(self) -> str:
        """Hash of everything that the run wrote. Raises SessionError when it is not finished."""
        if self._run.outputs_sha256 is None:
            raise SessionError(f"step {self.name!r} is not finished; finish it before it is used")
        return self._run.outputs_sha256

    @property
    def done(self) -> bool:
        """Finished, and every file is still there."""
        return self._run.outputs_sha256 is not None and not self.damaged_files

    @property
    def damaged_files(self) -> list[str]:
        """Journalled files that are missing, or are not as they were written."""
        entries = self._run.files.values()
        return [e.file for e in entries if not self._ledger.is_intact(e)]

    @property
    def frame_names(self) -> list[str]:
        """Names of the frames, in the order in which they were first saved."""
        return [name for kind, name in self._run.files if kind == "frame"]

    def has_frame(self, name: str) -> bool:
        """Tell whether a frame was journalled and its file is intact.

        Parameters
        ----------
        name
            Of the frame.

        Returns
        -------
        bool
        """
        entry = self._run.files.get(("frame", name))
        return entry is not None and self._ledger.is_intact(entry)

    def reuse_frame(
        self, name: str, *, pattern: str, codes: Codes, asked_s: float, camera: str, projector: str
    ) -> bool:
        """Take over a frame of an earlier run that shows the same codes, so that nothing is photographed twice.

        Parameters
        ----------
        name
            As it shall be called in this run.
        pattern
            What is shown.
        codes
            Its codes; all of them have to be the same.
        asked_s
            Exposure that would be asked for. [s]
        camera, projector
            Names of the devices.

        Returns
        -------
        bool
            Whether there was one; each is taken over once a run, so that repeats stay different exposures.
        """
        wanted = (_sha256_of(codes), camera, projector, float(asked_s))
        for entry in self._ledger.earlier_frames(self._run):
            if entry.frame is not None and entry.frame.shown_as == wanted:
                self._check_unfinished()
                known = replace(entry, name=name, frame=replace(entry.frame, pattern=pattern))
                self._ledger.add_file(self._run, known)
                return True
        return False

    def save_frame(
        self,
        name: str,
        raw: RawFrame,
        *,
        pattern: str | None = None,
        codes: Codes | None = None,
        camera: str = "",
        projector: str = "",
        asked_s: float | None = None,
    ) -> None:
        """Write a frame to ``frames/STEP/NNNN.exr``; which devices made it, and when, goes to the journal.

        Parameters
        ----------
        name
            The frame's, by which it is read back.
        raw
            (H, W, 1 or 3) digital numbers, and times on the rig's clock.
        pattern
            Name of what was shown (default: ``name``); a replay finds the frame by it and by the exposure.
        codes
            What was shown; a replay refuses to show the frame for a picture that is not like it.
        camera, projector
            Names of the devices.
        asked_s
            Exposure that was asked for; a later run takes the frame over for the same codes and exposure. [s]

        Raises
        ------
        SessionError
            The step is finished, or the disk is full.
        """
        pixels = raw.pixels
        if pixels.dtype != np.uint16 or pixels.ndim != 3 or pixels.shape[2] not in _CHANNELS:
            raise ValueError(f"a frame is uint16 (H, W, 1 or 3), not {pixels.dtype} of shape {pixels.shape}")
        path = self._path("frame", name, f"frames/{self.name}/", "{:04d}.exr", first=0)
        channels = {c: pixels[..., k] for k, c in enumerate(_CHANNELS[pixels.shape[2]])}
        attributes = {"rig:step": self.name, "rig:name": name, "rig:exposure_s": repr(raw.exposure_s)}
        write_exr(path, channels, attributes)
        details = FrameDetails(
            camera=camera,
            projector=projector,
            pattern=pattern or name,
            exposure_s=float(raw.exposure_s),
            started_s=float(raw.started_s),
            sequence=int(raw.sequence),
            signature="" if codes is None else signature_of(codes),
            codes_sha256=None if codes is None or asked_s is None else _sha256_of(codes),
            asked_s=asked_s,
        )
        self._add("frame", name, path, details)

    def load_frame(self, name: str) -> RawFrame:
        """Read a frame back, exactly.

        Parameters
        ----------
        name
            As it was saved.

        Returns
        -------
        RawFrame
            (H, W, 1 or 3) digital numbers, and times on the rig's clock.

        Raises
        ------
        SessionError
            There is no such frame.
        SessionCorrupt
            Its file is damaged.
        """
        entry = self._entry("frame", name)
        channels = read_exr(self._ledger.folder / entry.file)
        pixels = np.dstack([channels[c] for c in _CHANNELS[len(channels)]]).astype(np.uint16)
        if entry.frame is None:
            raise SessionCorrupt(f"{entry.file}: the journal has no exposure for it; repeat step {self.name!r}")
        return RawFrame(
            pixels=pixels,
            exposure_s=entry.frame.exposure_s,
            started_s=entry.frame.started_s,
            sequence=entry.frame.sequence,
        )

    def save_image(
        self,
        name: str,
        channels: Mapping[str, NDArray[np.generic]],
        *,
        folder: Literal["images", "maps"] = "images",
        attributes: Mapping[str, str] | None = None,
    ) -> Path:
        """Write an image to ``FOLDER/NAME-NNN.exr``.

        Parameters
        ----------
        name
            By which it is read back.
        channels
            (H, W) each, by name; stored as float32.
        folder
            ``images``, or ``maps`` for what is known of each pixel.
        attributes
            Texts for viewers.

        Returns
        -------
        Path
            Of the file.
        """
        path = self._path("image", name, f"{folder}/{name}-", "{:03d}.exr", first=1)
        write_exr(path, channels, {"rig:step": self.name, **(attributes or {})})
        self._add("image", name, path)
        return path

    def load_image(self, name: str) -> dict[str, NDArray[np.float32]]:
        """Read an image.

        Parameters
        ----------
        name
            As it was saved.

        Returns
        -------
        dict
            (H, W) float32 channels by name.
        """
        return read_exr(self._ledger.folder / self._entry("image", name).file)

    def save_record(self, name: str, record: Record | Mapping[str, object]) -> Path:
        """Write a record to ``calibration/NAME-NNN.json``; floats come back exactly.

        Parameters
        ----------
        name
            By which it is read back.
        record
            Numbers, words, sequences and mappings; no NaN and no infinity.

        Returns
        -------
        Path
            Of the file.
        """
        path = self._path("record", name, f"calibration/{name}-", "{:03d}.json", first=1)
        write_json(path, json_of(record))
        self._add("record", name, path)
        return path

    def load_record(self, name: str, kind: type[Kind]) -> Kind:
        """Read a record of a kind, its fields checked.

        Parameters
        ----------
        name
            As it was saved.
        kind
            A frozen dataclass, or ``dict`` for whatever the file holds.

        Returns
        -------
        Record
            Of that kind.

        Raises
        ------
        SessionError
            The step has no such record.
        SessionCorrupt
            The file is damaged: no JSON, or not a record of this kind.
        """
        path = self._ledger.folder / self._entry("record", name).file
        try:
            return read_record(kind, json.loads(path.read_bytes()))
        except (ValueError, RecursionError) as error:
            raise SessionCorrupt(
                f"{path}: is no {kind.__name__} of this version ({error}); delete it, and run "
                f"`rig run {typed(self._ledger.folder)}`: step {self.name!r} makes it anew"
            ) from error

    def take_over(self, other: Step) -> None:
        """Copy all that a finished step of another session wrote, byte by byte, and finish.

        Parameters
        ----------
        other
            Of the same name, finished.

        Raises
        ------
        SessionCorrupt
            One of its files is damaged.
        """
        for kind, name in other._run.files:
            entry = other._entry(kind, name)
            path = self._ledger.folder / entry.file
            path.parent.mkdir(parents=True, exist_ok=True)
            write_bytes(path, (other._ledger.folder / entry.file).read_bytes())
            self._ledger.add_file(self._run, entry)
        self.finish()

    def finish(self) -> None:
        """Say that the step is complete."""
        self._check_unfinished()
        self._ledger.finish(self._run)
        self._is_writing = False

    def _path(self, kind: FileKind, name: str, prefix: str, pattern: str, *, first: int) -> Path:
        """Choose the file: the same again when this run has written it before, else the next free number."""
        check_name(name)
        self._check_unfinished()
        known = self._run.files.get((kind, name))
        if known is not None:
            return self._ledger.folder / known.file
        return self._ledger.folder / (prefix + pattern.format(self._ledger.files_like(prefix) + first))

    def _add(self, kind: FileKind, name: str, path: Path, frame: FrameDetails | None = None) -> None:
        self._ledger.add_file(self._run, self._ledger.entry_of(kind, name, path, frame))

    def _check_unfinished(self) -> None:
        if not self._is_writing and self.done:
            raise SessionError(f"step {self.name!r} is finished; begin it with other settings to write again")
        self._is_writing = True

    def _entry(self, kind: FileKind, name: str) -> FileEntry:
        entry = self._run.files.get((kind, name))
        if entry is None:
            known = ", ".join(n for k, n in self._run.files if k == kind) or "none"
            raise SessionError(f"step {self.name!r} has no {kind} {name!r}; it has {known}")
        if not self._ledger.is_intact(entry):
            raise SessionCorrupt(
                f"{self._ledger.folder / entry.file}: is missing, or not as step {self.name!r} wrote it; run "
                f"`rig run {typed(self._ledger.folder)}`, which makes it anew"
            )
        return entry


def _sha256_of(codes: Codes) -> str:
    return hashlib.sha256(repr(codes.shape).encode() + np.ascontiguousarray(codes).tobytes()).hexdigest()
