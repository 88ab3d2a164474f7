"""What a session has photographed and computed, as pictures with names that people understand, in one folder."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import chain, count
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rig.errors import UsageError
from rig.files.atomic import write_bytes
from rig.files.channels import SUFFIXES, image_of, one_or_all
from rig.files.exr import read_exr
from rig.files.pictures import write_png
from rig.records import Record
from rig.report import pictures
from rig.session import Session
from rig.session.ledger import FileEntry
from rig.terminal import OnStep, silent

Format = Literal["png", "exr"]
_FOLDERS: Mapping[str, str] = {
    "exposure": "1-exposure",
    "response": "2-response",
    "gray": "3-structured-light",
    "correspondence": "4-correspondence",
    "separation": "5-separation",
    "model": "6-model",
    "compensate": "7-compensation",
    "project": "8-photographs-of-strategies",
    "compare": "9-comparison",
}
"""Of steps, in the order in which they are done; a step of another name keeps its name."""
_LAYERS: Mapping[str, str] = {
    "codes": "as sent to the projector, codes of 255",
    "linear": "as sent to the projector, linear light, 1 = projector white",
    "light": "light at the camera, 1 = its full scale at the reference exposure",
    "sigma": "standard deviation of the light",
    "variance": "variance of the light",
    "column": "projector column that a camera pixel sees",
    "row": "projector row that a camera pixel sees",
    "sigma_column": "standard deviation of the column, in pixels",
    "sigma_row": "standard deviation of the row, in pixels",
    "reason": "why a pixel has no place in the projector's picture (0: it has one)",
    "direct": "light of projector white that was reflected once",
    "global": "light of projector white that was reflected more than once",
    "white": "all light of projector white",
    "valid": "1 where the light could be told apart",
    "grey": "target, grey levels of 255 in linear light",
    "target": "target as the camera should see it, grey levels of 255",
    "mask": "1 where errors are taken",
    "gain": "measured over simulated direct light of projector white",
    "global_gain": "measured over simulated global light of projector white",
    "lit": "1 where the projector lights what the camera sees",
}
"""What a layer of an image shows."""
_RAMPS = ("column", "row")
_AS_CODES, _AS_GREY_LEVELS = ("codes",), ("grey", "target")
_BRIGHT_QUANTILE = 0.995
"""What becomes white in a picture of light: glints may clip."""


@dataclass(frozen=True, kw_only=True)
class ExportedFile(Record):
    """A file of an export, and what it shows."""

    file: str
    """Below the export's folder."""
    step: str
    shows: str
    scale: str
    """What the picture's black and white stand for."""


@dataclass(frozen=True, kw_only=True)
class Export(Record):
    """What was written."""

    folder: str
    files: int
    contents: str
    """Table of the files (CSV)."""


def export_session(folder: Path, output: Path, kind: Format = "png", on_step: OnStep = silent) -> Export:
    """Write every frame, map and picture of a session into a new folder, with a table of what each file shows.

    Parameters
    ----------
    folder
        Of the session, which is only read.
    output
        Folder to make, or an empty one.
    kind
        ``png``: to look at, each on a scale that the table tells; ``exr``: the numbers, exactly.
    on_step
        Told how far it is.

    Returns
    -------
    Export

    Raises
    ------
    SessionError
        There is no session, a file is damaged, or the disk refuses.
    UsageError
        The output has files already.
    """
    session = Session.read(folder)
    _check_new(output)
    entries, written = list(session.files()), []
    for k, (step, entry) in enumerate(entries):
        on_step("export", k, len(entries))
        for name, shows, content, scale in _pictures(session, entry, kind):
            path = _free(output / _FOLDERS.get(step, step) / f"{name}.{kind}")
            path.parent.mkdir(parents=True, exist_ok=True)
            write_png(path, content) if isinstance(content, np.ndarray) else write_bytes(path, content)
            file = path.relative_to(output).as_posix()
            written.append(ExportedFile(file=file, step=step, shows=shows, scale=scale))
    on_step("export", len(entries), len(entries))
    contents = output / "contents.csv"
    write_bytes(contents, _table(written))
    return Export(folder=str(output), files=len(written), contents=str(contents))


def _free(path: Path) -> Path:
    """Return the path, numbered where a frame of the same picture and exposure has it already."""
    numbered = (path.with_name(f"{path.stem}-again{k}{path.suffix}") for k in count(1))
    return next(one for one in chain([path], numbered) if not one.exists())


def _check_new(output: Path) -> None:
    if output.exists() and (not output.is_dir() or any(output.iterdir())):
        raise UsageError(f"{output}: has files already; give a new or an empty folder with --output")
    try:
        output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"{output}: cannot be made: {error.strerror}; give another folder with --output") from error


_Picture = tuple[str, str, "NDArray[np.uint8] | bytes", str]
"""Name without its ending, what it shows, pixels or a file's bytes, and its scale."""


def _pictures(session: Session, entry: FileEntry, kind: Format) -> Iterator[_Picture]:
    name, shows = _name(entry), _shows(entry)
    if kind == "exr":
        yield name, shows, (session.path / entry.file).read_bytes(), "numbers as in the session"
        return
    channels = read_exr(session.path / entry.file)
    if entry.kind == "frame":
        yield name, shows, *_frame(session, channels)
        return
    found = {channel.removesuffix(suffix) for channel in channels for suffix in SUFFIXES[3] if channel.endswith(suffix)}
    grey = [channel for channel in channels if not channel.endswith(SUFFIXES[3])]
    for layer in sorted({*found, *grey}):
        words = _LAYERS.get(layer, layer.replace("_", " "))
        label = name if layer in ("codes", "light", "grey") else f"{name}-{layer.replace('_', '-')}"
        yield label, f"{shows}: {words}", *layer_picture(layer, image_of(channels, layer), channels)


def _frame(session: Session, channels: Mapping[str, NDArray[np.float32]]) -> tuple[NDArray[np.uint8], str]:
    full_scale = session.profile.camera.full_scale_dn
    bands = np.stack([channels[c] for c in ("R", "G", "B") if c in channels] or list(channels.values()), axis=-1)
    if full_scale <= 255:
        return one_or_all(np.clip(bands, 0, 255).astype(np.uint8)), "digital numbers as they are"
    return pictures.photograph(bands * (255 / full_scale)), f"0 to {full_scale} digital numbers, gamma 2.2"


def layer_picture(
    layer: str, image: NDArray[np.float32], channels: Mapping[str, NDArray[np.float32]]
) -> tuple[NDArray[np.uint8], str]:
    """Return a layer of an image (H, W, B) as a screen shows it, and its scale in words; `channels` are all of it."""
    finite = np.isfinite(image)
    if layer in _AS_CODES:
        return one_or_all(image.astype(np.uint8)), "codes as they are"
    if layer in _AS_GREY_LEVELS:
        return pictures.photograph(image), "0 to 255 grey levels of linear light, gamma 2.2"
    if layer == "reason":
        legend = ", ".join(f"{name} {colour}" for name, colour in pictures.reason_legend())
        return pictures.reasons(np.nan_to_num(image[..., 0])), legend
    if layer in _RAMPS:
        valid = finite[..., 0] & (channels["reason"] == 0 if "reason" in channels else True)
        low, high = (image[..., 0][valid].min(), image[..., 0][valid].max()) if valid.any() else (0, 0)
        return pictures.ramp(image[..., 0], valid, "turbo"), f"{low:.4g} (blue) to {high:.4g} (red)"
    top = float(np.quantile(image[finite], _BRIGHT_QUANTILE)) if finite.any() else 0.0
    return pictures.photograph(image * (255 / top if top > 0 else 0)), f"0 to {top:.4g}, gamma 2.2"


def _name(entry: FileEntry) -> str:
    """Return what a file is called: of a frame what the projector showed, the exposure, and which repeat it is."""
    if entry.frame is None:
        return entry.name
    repeat = re.search(r"\.r(\d+)$", entry.name)
    nth = f"-{int(repeat[1]) + 1}" if repeat and int(repeat[1]) else ""
    return f"{entry.frame.pattern}-{1000 * entry.frame.exposure_s:.4g}ms{nth}"


def _shows(entry: FileEntry) -> str:
    if entry.frame is None:
        return entry.name.replace("-", " ")
    return f"photograph while the projector shows {entry.frame.pattern}, exposed {1000 * entry.frame.exposure_s:.4g} ms"


def _table(files: list[ExportedFile]) -> bytes:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["file", "step", "shows", "scale"])
    writer.writerows([one.file, one.step, one.shows, one.scale] for one in files)
    return text.getvalue().encode()
