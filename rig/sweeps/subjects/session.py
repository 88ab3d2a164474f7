"""A whole session on a simulated rig as a subject: any key of its profile may vary."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from rig.errors import ProfileError, UsageError
from rig.records import JsonObject, json_of
from rig.sweeps.records import Evaluated
from rig.sweeps.subjects.base_file import digest_of, figures_of, text_with

if TYPE_CHECKING:
    from rig.profile.schema import Profile

_STRATEGIES = "strategies"
"""The one input that is not a key of the profile."""
_NOT_FIGURES = ("report", "elapsed_s")
_PROFILE = Path("profile with the point's settings")


class SessionSubject:
    """What ``rig run`` measures with a simulated rig; the strategies are those of a session unless named."""

    version = "1"

    def base_of(self, name: str | None, near: Path) -> str:
        """Return the text of the profile; raises ProfileError, UsageError."""
        from rig.profile.schema import load_profile

        if name is None:
            raise UsageError("base: missing; name the profile of a simulated rig, such as ci-tiny")
        beside = near / name
        profile = load_profile(beside if beside.is_file() else name)
        _refuse_devices(profile)
        return profile.text

    def complete(self, settings: Mapping[str, object], base: str | None) -> JsonObject:
        """Return the settings and what the profile is otherwise; raises ProfileError."""
        from rig.profile.schema import Profile
        from rig.run.request import DEFAULT_STRATEGIES
        from rig.stages.target import check_strategies

        names = settings.get(_STRATEGIES, DEFAULT_STRATEGIES)
        if not isinstance(names, list | tuple) or not names:
            raise ProfileError(f'{_STRATEGIES}: is {names!r}; give a list of names, e.g. ["none", "bounded"]')
        try:
            check_strategies(tuple(str(name) for name in names))
        except UsageError as error:
            raise ProfileError(f"{_STRATEGIES}: {error}") from error
        _refuse_devices(Profile.parse(_profile_text(settings, base), _PROFILE))
        inputs: JsonObject = {key: json_of(value) for key, value in settings.items()}
        return {**inputs, _STRATEGIES: json_of(list(names)), "base": digest_of(base or "")}

    def evaluate(self, inputs: JsonObject, base: str | None) -> Evaluated:
        """Run a session in a folder of its own, and return what its metrics.json holds as figures."""
        from rig.run.request import SessionRequest
        from rig.run.session import run_session

        names = inputs[_STRATEGIES]
        with tempfile.TemporaryDirectory(prefix="rig-sweep-") as folder:
            profile = Path(folder) / "point.toml"
            settings = {key: value for key, value in inputs.items() if key != "base"}
            profile.write_bytes(_profile_text(settings, base))
            strategies = tuple(str(name) for name in names) if isinstance(names, list) else ()
            request = SessionRequest(folder=Path(folder) / "session", profile=profile, strategies=strategies)
            result = run_session(request).as_json()
        return Evaluated(figures=dict(figures_of(result, _NOT_FIGURES)))


def _profile_text(settings: Mapping[str, object], base: str | None) -> bytes:
    return text_with(base or "", {key: value for key, value in settings.items() if key != _STRATEGIES})


def _refuse_devices(profile: Profile) -> None:
    drivers = {camera.driver for camera in profile.cameras} | {one.driver for one in profile.projectors}
    if drivers != {"simulated"}:
        others = ", ".join(sorted(drivers - {"simulated"}))
        raise UsageError(
            f"profile {profile.name} has devices with driver {others}: a sweep would run them at many points at once; "
            "give a simulated rig"
        )
