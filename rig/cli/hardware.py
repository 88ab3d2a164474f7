"""The verbs of the command line about what is plugged in, emulated rigs and profiles; no logic."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, Parameter

from rig.cli.options import Json, names_of, print_json
from rig.errors import UsageError

profile_app = App(name="profile", help="Write, check and upgrade hardware profiles.")


def devices(
    name: Annotated[
        str | None, Parameter(help="Only devices that this names: device id, node, connector, part of the name.")
    ] = None,
    *,
    everything: Annotated[
        bool, Parameter(name="--all", negative="", help="All formats, controls and modes; a name does so too.")
    ] = False,
    as_json: Json = False,
) -> int:
    """List what is plugged in, with its lines for a profile, and the installed drivers, strategies and codes.

    Cameras, display outputs, monitors of the desktop, projector controllers; other packages may add drivers, strategies
    and structured-light codes (docs/how-to/plug-ins.md).

    Example: rig devices --json
    """
    from rig.inventory.list import list_devices
    from rig.inventory.tables import print_devices

    result = list_devices(name)
    print_json(result.as_json()) if as_json else print_devices(result, everything or name is not None)
    return 0


def check(
    *,
    profile: Annotated[str, Parameter(name=["--profile", "-p"], help="Profile file or name.")],
    only: Annotated[str, Parameter(help="Parts to measure, separated by commas; default: all.")] = "",
    report: Annotated[Path | None, Parameter(help="HTML file to write, with charts.")] = None,
    apply: Annotated[bool, Parameter(negative="", help="Write the measured values into the profile's file.")] = False,
    as_json: Json = False,
) -> int:
    """Open a rig and measure what every rig must keep; prints values for its profile.

    Parts: latency, exposure, pipeline, flicker, linearity, noise, saturation, pixels, darkness, additivity, checker,
    ramp, view, stability.

    Example: rig check -p sim-room --only latency,noise --report check.html
    """
    from rig.terminal import TerminalProgress

    with TerminalProgress() as progress:
        from rig.files.atomic import check_output
        from rig.profile.apply import apply_values, own_file
        from rig.self_check import run_check
        from rig.self_check.page import print_check, write_check_page

        if report is not None:
            check_output(report)
        own = own_file(profile) if apply else None
        result = run_check(profile, progress, names_of(only) if only else ())
    if report is not None:
        result = result.with_report(write_check_page(result, report))
    applied = None if own is None else apply_values(own, result.suggested)
    print_json({**result.as_json(), **({} if applied is None else {"applied": applied})}) if as_json else print_check(
        result, applied
    )
    return 0 if result.within_limits else 1


def emulate(
    *,
    profile: Annotated[str, Parameter(name=["--profile", "-p"], help="Profile with a [simulation]: the room.")] = (
        "emulated-rig"
    ),
    display: Annotated[
        str | None, Parameter(help="Display output to look at, e.g. HDMI-A-1; default: the profile's.")
    ] = None,
    picture: Annotated[Path | None, Parameter(help="Still picture to look at instead of a display.")] = None,
    as_json: Json = False,
) -> int:
    """Plug a simulated USB camera into this machine, for any program; it sees a display in a simulated room.

    Needs root, and Linux with the modules vhci-hcd and uvcvideo. Ends with "quit" or Ctrl-C.

    Example: sudo rig emulate --picture photograph.png
    """
    from rig.emulated.commands import PluggedCamera, run_emulated

    def ready(found: PluggedCamera) -> None:
        text = f"{found.node} is an emulated camera, {found.device_id}; it sees {found.display}. Type help or quit."
        print(json.dumps(found.as_json()) if as_json else text, flush=True)

    def told(text: str) -> None:
        print(text, file=sys.stderr, flush=True)

    run_emulated(profile, display, picture, on_ready=ready, tell=told)
    return 0


def virtual(
    *,
    kind: Annotated[Literal["gige", "still"], Parameter(help="Which camera.")],
    profile: Annotated[
        str | None, Parameter(name=["--profile", "-p"], help="Profile with a [simulation]; default: emulated-KIND.")
    ] = None,
    as_json: Json = False,
) -> int:
    """Serve a virtual camera that looks at a virtual display in a simulated room; needs neither hardware nor root.

    A GigE Vision camera on the loopback network, for any GenICam program; or a still camera behind gphoto2's virtual
    port, for this one. Ends with "quit" or Ctrl-C.

    Example: rig virtual --kind gige
    """
    from rig.emulated.virtual import ServedCamera, run_virtual

    def ready(found: ServedCamera) -> None:
        text = f"{found.device_id} is a virtual camera ({found.kind}); it sees the virtual display {found.display}."
        print(json.dumps(found.as_json()) if as_json else f"{text} Type help or quit.", flush=True)

    def told(text: str) -> None:
        print(text, file=sys.stderr, flush=True)

    run_virtual(kind, profile, on_ready=ready, tell=told)
    return 0


@profile_app.command(name="check")
def profile_check(*files: str, as_json: Json = False) -> int:
    """Validate profiles, and files of facts about hardware: every problem of every file, a line each.

    Example: rig profile check hw_profiles/*.toml
    """
    from rig.inventory.check_files import check_files

    if not files:
        raise UsageError("rig profile check needs at least one file, e.g. hw_profiles/sim-room.toml")
    checked = check_files(list(files))
    if as_json:
        print_json({"files": [{"path": c.path, "ok": c.ok, "problems": list(c.problems)} for c in checked]})
    else:
        for one in checked:
            print("\n".join(one.problems) if one.problems else one.summary)
    return 0 if all(one.ok for one in checked) else 2


@profile_app.command(name="upgrade")
def profile_upgrade(
    path: Annotated[Path, Parameter(help="Profile of an older version (.toml).")], *, as_json: Json = False
) -> int:
    """Rewrite a profile of an older version as this one reads it; comments stay, the old file is kept beside it.

    Example: rig profile upgrade lab.toml
    """
    from rig.profile.upgrade import upgrade_profile

    upgraded = upgrade_profile(path)
    if as_json:
        print_json(upgraded.as_json())
    else:
        print(upgraded.diff)
        print(f"{upgraded.path}: upgraded; the old file is {upgraded.backup}")
    return 0


@profile_app.command(name="new")
def profile_new(
    path: Annotated[Path, Parameter(help="Profile to write (.toml).")],
    *,
    camera: Annotated[str | None, Parameter(help="Device id, if there are several; see rig devices.")] = None,
    output: Annotated[str | None, Parameter(help="Connector or monitor, if there are several.")] = None,
    camera_model: Annotated[str | None, Parameter(help="Model in hw_profiles/cameras; default: by USB ids.")] = None,
    projector_model: Annotated[str | None, Parameter(help="Model in hw_profiles/projectors.")] = None,
    name: Annotated[str | None, Parameter(help="The profile's name; default: the file's.")] = None,
    force: Annotated[bool, Parameter(negative="", help="Replace a file that is there.")] = False,
    as_json: Json = False,
) -> int:
    """Write a profile from what is plugged in and what is publicly known of it; says what is left to measure.

    Example: rig profile new lab.toml --projector-model PW800
    """
    from rig.inventory.new_profile import ProfileRequest, write_profile
    from rig.inventory.tables import print_new_profile

    request = ProfileRequest(
        path=path,
        camera=camera,
        output=output,
        camera_model=camera_model,
        projector_model=projector_model,
        name=name,
        force=force,
    )
    result = write_profile(request)
    print_json(result.as_json()) if as_json else print_new_profile(result)
    return 0
