"""The command line `rig`: its verbs, put together. stdout is the result, stderr is progress.

Exit status: 0 ok, 1 outside limits, 2 usage or profile, 3 device, 4 session, 130 interrupted.
"""

from __future__ import annotations

import sys
from collections.abc import Callable

import cyclopts
from cyclopts import App

from rig.cli import hardware, live, session, studies
from rig.errors import RigError


def _version() -> str:
    from rig.version import __version__  # its look-up takes a moment

    return __version__


app = App(
    name="rig",
    help="Controller of a projector-camera rig: calibrate a room, simulate its interreflection, compensate it, "
    "and measure what was gained.\n\nStart with: rig run runs/first -p sim-room",
    help_format="markdown",
    version=_version,
    version_flags=["--version", "-V"],
    suppress_keyboard_interrupt=False,
)
VERBS: dict[str, Callable[..., int]] = {
    "run": session.run,
    "calibrate": session.calibrate,
    "separate": session.separate,
    "model": session.model,
    "compensate": session.compensate,
    "compare": session.compare,
    "compare-strategies": studies.compare_strategies,
    "report": session.report,
    "live": live.live,
    "check": hardware.check,
    "devices": hardware.devices,
    "emulate": hardware.emulate,
    "lenses": studies.lenses,
    "scan": studies.scan,
    "simulate": studies.simulate,
    "paper": studies.paper,
    "bench": studies.bench,
}
for name, verb in VERBS.items():
    app.command(verb, name=name)
app.command(hardware.profile_app)


_SMALLER = "give smaller pictures, coarser patches or a looser tolerance, or free some memory"


def run_command(arguments: list[str]) -> int:
    """Run one command line and return its exit status."""
    try:
        result = app(arguments, exit_on_error=False, print_error=False, result_action="return_value")
    except cyclopts.CycloptsError as error:
        print(f"rig: {error}\ntry: {_help_of(arguments)}", file=sys.stderr)
        return 2
    except RigError as error:
        print(f"rig: {error}", *getattr(error, "__notes__", ()), sep="\nrig: ", file=sys.stderr)
        return error.exit_code
    except MemoryError as error:
        print(f"rig: not enough memory: {error or 'the system gives no more'}; {_SMALLER}", file=sys.stderr)
        return 2
    except BrokenPipeError:  # whoever reads the result has seen enough: the process ends quietly
        raise
    except OSError as error:  # a disk or a file that refuses
        print(f"rig: {error}; check the disk, then run the same command again", file=sys.stderr)
        return 4
    return result if isinstance(result, int) else 0


def _help_of(arguments: list[str]) -> str:
    """The command that explains the verb, or all verbs when there is no such verb."""
    named = arguments[:2] if arguments[:1] == ["profile"] else arguments[:1]
    known = ({*app}, {*hardware.profile_app})
    verbs = [word for word, there in zip(named, known, strict=False) if word in there]
    return " ".join(["rig", *verbs, "--help"])
