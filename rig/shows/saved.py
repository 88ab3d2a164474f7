"""Saved shows: a TOML file says what is shown, from when to when, and what is kept of it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from rig.errors import UsageError
from rig.files.atomic import write_bytes
from rig.files.toml import Table, read_model, toml_text
from rig.live.plan import LiveRequest
from rig.shows.timetable import Timetable

FOLDER = Path("shows")
"""In which a show is looked for by its name, from where the program was started."""


def _spans(words: tuple[str, ...]) -> tuple[str, ...]:
    Timetable.of(words)
    return words


class OscSettings(Table):
    """Where a show listens for commands of show control."""

    port: Annotated[int, Field(ge=1, le=65535)] = 9000
    host: str = "127.0.0.1"
    """Address to listen on; another than the machine's own lets everybody on the network in."""


class LogSettings(Table):
    """What a show writes down of itself."""

    size_mb: Annotated[float, Field(gt=0)] = 5.0
    """Of one file; then the next is begun."""
    files: Annotated[int, Field(ge=1, le=100)] = 5
    """How many are kept."""


class SavedShow(Table):
    """What is shown, when, and what is kept of it; paths are relative to the file."""

    session: str | None = None
    """Folder of a session with a model."""
    profile: str | None = None
    """File or name, where there is no session, or another than the session's."""
    sources: Annotated[tuple[str, ...], Field(min_length=1)] = ("pattern",)
    """As of `rig live --source`; they are played for ever."""
    strategy: Literal["exact", "bounded", "none"] = "bounded"
    gain: Annotated[float, Field(gt=0, le=4)] = 1.0
    auto_gain: bool = False
    linear: bool = False
    on: Annotated[tuple[str, ...], AfterValidator(_spans)] = ()
    """Spans of each day like "09:00-18:30", local time; empty: always."""
    switch_off: bool = False
    """Switch the projector's lamp off by PJLink while the show is off."""
    lamp_hours_limit: Annotated[float, Field(gt=0)] | None = None
    """After so many hours the log asks for a new lamp."""
    record: str | None = None
    """Folder in which each run makes one of its own."""
    record_limit_gb: Annotated[float, Field(gt=0)] = 10.0
    """Of all recordings together; the oldest pictures go first."""
    log: LogSettings = LogSettings()
    osc: OscSettings | None = None
    """None: no commands are listened to."""

    @property
    def timetable(self) -> Timetable:
        """When it is on."""
        return Timetable.of(self.on)


def load_show(name: str) -> tuple[SavedShow, Path]:
    """Read a saved show.

    Parameters
    ----------
    name
        Its file, or its bare name: then ``shows/NAME.toml``.

    Returns
    -------
    (SavedShow, Path)
        The show, and its file.

    Raises
    ------
    UsageError
        There is none of that name, or it names neither a session nor a profile.
    ProfileError
        Something in the file is wrong, a line each.
    """
    given = Path(name)
    path = given if given.is_file() else FOLDER / f"{name}.toml"
    if not path.is_file():
        known = ", ".join(sorted(file.stem for file in FOLDER.glob("*.toml"))) or "none"
        raise UsageError(f"{name}: no such show; give a file, or one of {FOLDER}/: {known}")
    show = read_model(SavedShow, path.read_bytes(), path, lambda _: [])
    refuse_without_rig(show, path)
    return show, path


def refuse_without_rig(show: SavedShow, path: Path) -> None:
    """Refuse a show that says of no rig that it is its own. Raises UsageError."""
    if show.session is None and show.profile is None:
        raise UsageError(f'{path}: names neither a session nor a profile; add session = "runs/…"')


def write_show(show: SavedShow, path: Path) -> None:
    """Write a show's file; what is as it is anyway is left out.

    Parameters
    ----------
    show
        To be saved; its paths begin in the file's folder.
    path
        Of the file; the folder is made if it is not there.

    Raises
    ------
    UsageError
        It names neither a session nor a profile.
    SessionError
        The disk refuses it.
    """
    refuse_without_rig(show, path)
    said = show.model_dump(mode="json", exclude_defaults=True, exclude_none=True)
    write_bytes(path, toml_text(said).encode())


def request_of(show: SavedShow, path: Path) -> LiveRequest:
    """Return what is asked of the live pictures, but for its time and its recording.

    Parameters
    ----------
    show
        Saved.
    path
        Its file.

    Returns
    -------
    LiveRequest
    """
    folder = path.parent
    profile = show.profile
    if profile is not None and (folder / profile).is_file():
        profile = str(folder / profile)
    return LiveRequest(
        folder=None if show.session is None else folder / show.session,
        profile=profile,
        sources=tuple(str(folder / word) if (folder / word).exists() else word for word in show.sources),
        strategy=show.strategy,
        endless=True,
        keeps_going=True,
        gain=show.gain,
        auto_gain=show.auto_gain,
        is_linear=show.linear,
    )
