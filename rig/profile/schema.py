"""Hardware profiles: one TOML file describes a rig; every mistake in it is reported at once, a line each."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import Field, PrivateAttr

from rig.devices.simulated.settings import AT_LEAST_ONE, SimulationSettings
from rig.errors import ProfileError
from rig.files.toml import Table, read_model
from rig.profile.between_tables import problems_between_tables
from rig.profile.tables import (
    Brightness,
    CameraProfile,
    CaptureTiming,
    Limits,
    Name,
    Patterns,
    ProjectorProfile,
    Replay,
    Room,
    Scale,
    Surface,
    TransportPhotographs,
    Viewer,
    check_patches,
)
from rig.profile.target_table import TargetTable

SCHEMA = 2
"""The profile schema that this version reads and writes."""
SEVERAL_FROM = "0.3"
"""The version that will run several cameras or projectors."""
SURFACES_FROM = "0.4"
"""The version that will run surfaces other than boxes, and judge the picture from a point."""

Device = TypeVar("Device", CameraProfile, ProjectorProfile)


class Profile(Table):
    """A validated hardware profile; ``raw`` are the bytes it was read from."""

    schema_: Annotated[Literal[2], Field(alias="schema")]
    name: Name
    description: str = ""
    cameras: Annotated[tuple[CameraProfile, ...], Field(alias="camera"), AT_LEAST_ONE]
    projectors: Annotated[tuple[ProjectorProfile, ...], Field(alias="projector"), AT_LEAST_ONE]
    timing: CaptureTiming = CaptureTiming()
    scales: Annotated[tuple[Scale, ...], Field(alias="scale"), AT_LEAST_ONE]
    surface: Surface
    viewer: Viewer | None = None
    """Who judges the picture; None: the only camera."""
    patterns: Patterns = Patterns()
    transport: TransportPhotographs = TransportPhotographs()
    target: TargetTable = TargetTable()
    brightness: Brightness = Brightness()
    limits: Limits = Limits()
    replay: Replay | None = None
    simulation: SimulationSettings | None = None
    """The simulated truth; only simulated devices, the emulated rig and the scoring of results may look at it."""

    _raw: bytes = PrivateAttr(default=b"")
    _path: Path = PrivateAttr(default=Path())

    @classmethod
    def parse(cls, raw: bytes, path: Path) -> Profile:
        """Validate a profile's bytes.

        Parameters
        ----------
        raw
            TOML.
        path
            Names it in messages and anchors relative paths.

        Returns
        -------
        Profile

        Raises
        ------
        ProfileError
            With a line for each problem.
        """
        profile = read_model(cls, raw, path, partial(_problems, path))
        profile._raw, profile._path = raw, path.absolute()  # noqa: SLF001 - this class's own
        return profile

    @property
    def raw(self) -> bytes:
        """The exact bytes of the file."""
        return self._raw

    @property
    def text(self) -> str:
        """The same as text, without a mark of its encoding."""
        return self._raw.decode("utf-8-sig")

    @property
    def sha256(self) -> str:
        """Hexadecimal hash of ``raw``."""
        return hashlib.sha256(self._raw).hexdigest()

    @property
    def path(self) -> Path:
        """Absolute path of the file it was read from."""
        return self._path

    @property
    def camera(self) -> CameraProfile:
        """The only camera. Raises ProfileError when there are several, which a later version will run."""
        return self._only("camera", self.cameras)

    @property
    def projector(self) -> ProjectorProfile:
        """The only projector. Raises ProfileError when there are several, which a later version will run."""
        return self._only("projector", self.projectors)

    @property
    def scale(self) -> Scale:
        """The only length. Raises ProfileError when there are several, which a later version will use."""
        if len(self.scales) > 1:
            raise ProfileError(f"{self._path}: {_several_lengths(self)}")
        return self.scales[0]

    @property
    def room(self) -> Room:
        """The room of the surface. Raises ProfileError for a kind without one, which a later version will run."""
        if not isinstance(self.surface, Room):
            raise ProfileError(f"{self._path}: {_other_surface(self)}")
        return self.surface

    @property
    def recording(self) -> Path:
        """Absolute path of the replayed session or manifest. Raises ProfileError when there is none."""
        named = self.replay and (self.replay.session or self.replay.manifest)
        if not named:
            raise ProfileError(f"{self._path}: replay: this profile replays nothing; use driver = 'replay'")
        return self._path.parent / named

    @property
    def recorded(self) -> Profile | None:
        """The profile of the session that is replayed; None for photographs. Raises ProfileError."""
        replays_photographs = self.replay is not None and self.replay.manifest is not None
        return None if replays_photographs else load_profile(self.recording / "profile.toml")

    def with_device(self, device: CameraProfile | ProjectorProfile) -> Profile:
        """Return the same profile, the camera or projector of that name replaced.

        Parameters
        ----------
        device
            With the name of the one that it stands for.

        Returns
        -------
        Profile
        """
        return self.model_copy(
            update={
                "cameras": tuple(device if one.name == device.name else one for one in self.cameras),
                "projectors": tuple(device if one.name == device.name else one for one in self.projectors),
            }
        )

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Profile:
        """Return a copy with some tables replaced, not validated.

        Parameters
        ----------
        update
            New tables by name.
        deep
            Copy all tables, too.

        Returns
        -------
        Profile

        Raises
        ------
        ValueError
            For what is no table's name.
        """
        unknown = set(update or ()) - set(type(self).model_fields)
        if unknown:
            raise ValueError(f"a profile has no {', '.join(sorted(unknown))}; with_device() replaces one device")
        return super().model_copy(update=update, deep=deep)

    def _only(self, kind: str, devices: tuple[Device, ...]) -> Device:
        if len(devices) > 1:
            raise ProfileError(f"{self._path}: {_several(kind, devices)}")
        return devices[0]


def not_yet_run(profile: Profile) -> tuple[str, ...]:
    """Return a line for all in a valid profile that a later version will run, and this one refuses to."""
    found = [
        _several(kind, devices)
        for kind, devices in (("camera", profile.cameras), ("projector", profile.projectors))
        if len(devices) > 1
    ]
    if len(profile.scales) > 1:
        found.append(_several_lengths(profile))
    if not isinstance(profile.surface, Room):
        found.append(_other_surface(profile))
    if profile.viewer is not None and profile.viewer.point_m is not None:
        found.append(
            f"viewer.point_m: version {SURFACES_FROM} will judge the picture from a point; this one does it "
            "from a camera"
        )
    return tuple(found)


def _several(kind: str, devices: tuple[CameraProfile, ...] | tuple[ProjectorProfile, ...]) -> str:
    names = ", ".join(device.name for device in devices)
    return (
        f"{kind}: there are {len(devices)} ({names}); version {SEVERAL_FROM} will run several, this one runs one "
        "camera and one projector"
    )


def _several_lengths(profile: Profile) -> str:
    return f"scale: there are {len(profile.scales)} lengths; version {SEVERAL_FROM} will use several, this one uses one"


def _other_surface(profile: Profile) -> str:
    return f"surface.kind: version {SURFACES_FROM} will run {profile.surface.kind!r}, this one runs box, free and file"


def load_runnable_profile(path_or_name: str | Path) -> Profile:
    """Load a profile, as :func:`load_profile`, and refuse what only a later version will run. Raises ProfileError."""
    profile = load_profile(path_or_name)
    refuse_what_comes_later(profile)
    return profile


def refuse_what_comes_later(profile: Profile) -> None:
    """Raise ProfileError, a line for each reason, when this version reads a profile but cannot run it."""
    if later := not_yet_run(profile):
        raise ProfileError("\n".join(f"{profile.path}: {line}" for line in later))


def refuse_many_patches(size_m: tuple[float, float, float], patch_size_m: float) -> None:
    """Raise ProfileError, before memory is asked for, when a measured room has more patches than fit in it."""
    try:
        check_patches(size_m, patch_size_m, "surface.patch_size_m")
    except ValueError as error:
        raise ProfileError(str(error)) from error


def _problems(path: Path, data: dict[str, Any]) -> list[str]:
    """What no single table shows. Raises ProfileError for another schema, before anything else."""
    _refuse_other_schema(data, path)
    return problems_between_tables(data)


def _refuse_other_schema(data: Mapping[str, Any], path: Path) -> None:
    schema = data.get("schema")
    if not isinstance(schema, int) or schema == SCHEMA:
        return
    if schema > SCHEMA:
        raise ProfileError(
            f"{path}: schema: {schema} is newer than {SCHEMA}, the newest that this version reads; update procam-rig"
        )
    if is_of_a_session(path):
        raise ProfileError(
            f"{path}: schema: {schema} is older than {SCHEMA}: the session was made with an older version of "
            "procam-rig; go on with that version, or begin a new session"
        )
    raise ProfileError(
        f"{path}: schema: {schema} is older than {SCHEMA}, which this version reads; run: rig profile upgrade {path}"
    )


def is_of_a_session(path: Path) -> bool:
    """Whether a file is the copy of its profile that a session keeps."""
    return path.name == "profile.toml" and (path.parent / "session.json").is_file()


def load_profile(path_or_name: str | Path) -> Profile:
    """Read and validate a profile.

    Parameters
    ----------
    path_or_name
        Its file, or the bare name of one in ``hw_profiles`` (``"sim-room"``).

    Returns
    -------
    Profile

    Raises
    ------
    ProfileError
        It is not found; or there is something wrong with it, a line each.
    """
    path = _find(path_or_name)
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise ProfileError(f"{path}: cannot be read: {error.strerror}; check the name and its permissions") from error
    return Profile.parse(raw, path)


def _find(path_or_name: str | Path) -> Path:
    given = Path(path_or_name)
    if given.is_file():
        return given
    folders = (Path("hw_profiles"), Path(__file__).parents[2] / "hw_profiles")
    if given.name == str(path_or_name):
        name = given.name.removesuffix(".toml") + ".toml"
        for folder in folders:
            if (folder / name).is_file():
                return folder / name
    known = sorted({file.stem for folder in folders for file in folder.glob("*.toml")})
    raise ProfileError(f"{path_or_name}: no such profile; give a file or one of {', '.join(known) or '(none)'}")
