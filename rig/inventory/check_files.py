"""Checks files of `hw_profiles`, whether they describe a rig or cite what is known of a model: verb `profile check`."""

from __future__ import annotations

from pathlib import Path

from rig.errors import ProfileError
from rig.profile.check import CheckedProfile, check_profiles
from rig.profile.hardware_facts import HardwareFile, kind_of, parse_facts


def check_files(paths: list[str]) -> list[CheckedProfile]:
    """Validate each file; a broken one does not hide the others."""
    return [_check(path) for path in paths]


def _check(path: str) -> CheckedProfile:
    try:
        raw = Path(path).read_bytes() if Path(path).is_file() else b""
        if kind_of(raw, Path(path)) is None:
            return check_profiles([path])[0]
        file = parse_facts(raw, Path(path))
    except (ProfileError, OSError) as error:
        return CheckedProfile(path, tuple(str(error).splitlines()), "")
    return CheckedProfile(path, (), _summary(path, file))


def _summary(path: str, file: HardwareFile) -> str:
    facts, sources = len(file.facts.model_fields_set), len(file.sources)
    return (
        f"{path}: ok: {file.kind} {file.maker} {file.model}, {facts} facts from {sources} "
        f"source{'s' if sources > 1 else ''}, {len(file.to_be_measured)} to be measured"
    )
