"""What is wrong with profiles, file by file."""

from __future__ import annotations

from dataclasses import dataclass

from rig.errors import ProfileError
from rig.profile.apply import GUESS, guessed_keys
from rig.profile.schema import Profile, load_profile, not_yet_run
from rig.records import Record


@dataclass(frozen=True, slots=True)
class CheckedProfile(Record):
    """What `rig profile check` says of one file."""

    path: str
    problems: tuple[str, ...]
    summary: str
    """Lines for people when there is no problem: what it describes, and what only a later version will run."""

    @property
    def ok(self) -> bool:
        """No problem was found."""
        return not self.problems


def check_profiles(paths: list[str]) -> list[CheckedProfile]:
    """Validate each file; a broken one does not hide the others."""
    return [_check(path) for path in paths]


def _check(path: str) -> CheckedProfile:
    try:
        profile = load_profile(path)
    except ProfileError as error:
        return CheckedProfile(path, tuple(str(error).splitlines()), "")
    lines = [f"{path}: ok: {_described(profile)}", *_guesses(path, profile), *_later(path, profile)]
    return CheckedProfile(path, (), "\n".join(lines))


def _described(profile: Profile) -> str:
    drivers = dict.fromkeys(device.driver for device in profile.cameras)
    sizes = (
        _sizes("camera", [(one.name, one.width_px, one.height_px) for one in profile.cameras]),
        _sizes("projector", [(one.name, one.width_px, one.height_px) for one in profile.projectors]),
    )
    return f"{profile.name}, {' and '.join(drivers)}, {', '.join(sizes)}"


def _sizes(kind: str, devices: list[tuple[str, int, int]]) -> str:
    if len(devices) == 1:
        return f"{kind} {devices[0][1]} x {devices[0][2]} px"
    return f"{len(devices)} {kind}s: " + ", ".join(f"{name} {width} x {height} px" for name, width, height in devices)


def _guesses(path: str, profile: Profile) -> list[str]:
    guessed = guessed_keys(profile.text)
    if not guessed:
        return []
    return [
        f"{path}: still a guess ({GUESS}): {', '.join(guessed)}; rig check --apply measures some of them; where you "
        "measured one, take the word out of its line"
    ]


def _later(path: str, profile: Profile) -> list[str]:
    return [f"{path}: valid, but not run yet: {line}" for line in not_yet_run(profile)]
