"""The command line `rig`: its verbs, put together. stdout is the result, stderr is progress.

Exit status: 0 ok, 1 outside limits, 2 usage or profile, 3 device, 4 session, 130 interrupted.
"""

from __future__ import annotations

import shlex
import sys
from collections.abc import Callable
from typing import Annotated, Literal

import cyclopts
from cyclopts import App, Group, Parameter

from rig.cli import by_hand, hardware, live, page, rooms, session, studies
from rig.errors import RigError, UsageError
from rig.terminal.sentences import say


def _version() -> str:
    from rig.version import __version__  # its look-up takes a moment

    return __version__


def _default(value: object) -> str | None:
    """Return a default in a reader's words; None for a switch that is off and for what is empty, which say nothing."""
    match value:
        case None | False | "" | ():
            return None
        case True:
            return "on"
        case tuple():
            return ", ".join(map(str, value))
        case float():
            return f"{value:g}"
    return str(value)


app = App(
    name="rig",
    help="Controller of a projector-camera rig: calibrate a room, simulate its interreflection, compensate it, "
    "and measure what was gained.\n\nStart with: rig run runs/first -p sim-room",
    help_format="markdown",
    version=_version,
    version_flags=["--version", "-V"],
    suppress_keyboard_interrupt=False,
    default_parameter=Parameter(show_default=_default),
)
_SET_UP = Group("Set up a rig", sort_key=1)
_SESSION = Group("A session, in order", sort_key=2)
_SHOW = Group("Show and compare", sort_key=3)
_OFFLINE = Group("Without a rig", sort_key=4)
_PROGRAM = Group("The program", sort_key=5)
VERBS: dict[str, tuple[Callable[..., int], Group]] = {
    "devices": (hardware.devices, _SET_UP),
    "show": (by_hand.show, _SET_UP),
    "look": (by_hand.look, _SET_UP),
    "check": (hardware.check, _SET_UP),
    "lenses": (studies.lenses, _SET_UP),
    "emulate": (hardware.emulate, _SET_UP),
    "virtual": (hardware.virtual, _SET_UP),
    "run": (session.run, _SESSION),
    "calibrate": (session.calibrate, _SESSION),
    "separate": (session.separate, _SESSION),
    "model": (session.model, _SESSION),
    "compensate": (session.compensate, _SESSION),
    "compare": (session.compare, _SESSION),
    "report": (session.report, _SESSION),
    "export": (by_hand.export, _SESSION),
    "recheck": (session.recheck, _SHOW),
    "live": (live.live, _SHOW),
    "serve": (page.serve, _SHOW),
    "compare-strategies": (studies.compare_strategies, _SHOW),
    "simulate": (studies.simulate, _OFFLINE),
    "plan": (rooms.plan, _OFFLINE),
    "sweep": (studies.sweep, _OFFLINE),
    "scan": (studies.scan, _OFFLINE),
    "paper": (studies.paper, _OFFLINE),
    "bench": (studies.bench, _OFFLINE),
}
"""By name, in the order of use, with the group in which `rig --help` lists them."""


def help_of(*verb: Annotated[str, Parameter(help="Verb to explain; default: all.")]) -> int:
    """Explain a verb: the same as `rig VERB --help`.

    Example: rig help run
    """
    app.help_print(list(verb)) if _is_verb(verb) else _refuse_verb(verb)
    return 0


_ZSH_CALL = """
if [[ ${funcstack[1]} == _rig ]]; then
  _cyclopts_rig "$@"
else
  compdef _cyclopts_rig rig
fi
"""
"""What the generator leaves out: it defines the function that completes, and nothing calls it."""


def completion(
    shell: Annotated[Literal["bash", "zsh", "fish"], Parameter(help="bash, zsh or fish.")],
) -> int:
    """Print a script that completes verbs and options in a shell.

    bash: rig completion bash > ~/.local/share/bash-completion/completions/rig; zsh: into a file _rig of a folder of
    $fpath; fish: into ~/.config/fish/completions/rig.fish.

    Example: rig completion bash
    """
    script = app.generate_completion(shell=shell)
    print(script + _ZSH_CALL if shell == "zsh" else script)
    return 0


def _is_verb(words: tuple[str, ...]) -> bool:
    inner = {"profile": {*hardware.profile_app}}
    return not words or (words[0] in {*app} and (len(words) == 1 or words[1] in inner.get(words[0], set())))


def _refuse_verb(words: tuple[str, ...]) -> None:
    raise UsageError(f"there is no verb {' '.join(words)!r}; rig --help lists all")


for position, (name, (verb, group)) in enumerate(VERBS.items()):
    app.command(verb, name=name, group=group, sort_key=position)
hardware.profile_app.group, hardware.profile_app.sort_key = _SET_UP, 0
app.command(hardware.profile_app)
app.command(help_of, name="help", group=_PROGRAM)
app.command(completion, group=_PROGRAM)
app["--help"].group = _PROGRAM
app["--version"].group = _PROGRAM


_SMALLER = "give smaller pictures, coarser patches or a looser tolerance, or free some memory"


def run_command(arguments: list[str]) -> int:
    """Run one command line and return its exit status."""
    try:
        result = app(arguments, exit_on_error=False, print_error=False, result_action="return_value")
    except cyclopts.CycloptsError as error:
        say(f"rig: {_worded(error)}\ntry: {_help_of(arguments)}", sys.stderr)
        return 2
    except RigError as error:
        say("\nrig: ".join([f"rig: {error}", *getattr(error, "__notes__", ())]), sys.stderr)
        return error.exit_code
    except MemoryError as error:
        say(f"rig: not enough memory: {error or 'the system gives no more'}; {_SMALLER}", sys.stderr)
        return 2
    except BrokenPipeError:  # whoever reads the result has seen enough: the process ends quietly
        raise
    except OSError as error:  # a disk or a file that refuses
        say(f"rig: {error}; check the disk, then run the same command again", sys.stderr)
        return 4
    return result if isinstance(result, int) else 0


def _worded(error: cyclopts.CycloptsError) -> str:
    """Return what is wrong with a command line: a word that is missing, or one too many, as its reader calls it."""
    if isinstance(error, cyclopts.UnusedCliTokensError) and error.unused_tokens:
        words = " ".join(shlex.quote(word) for word in error.unused_tokens)
        return f"nothing is done with `{words}`; put names that have blanks between quotes, or leave it out"
    argument = error.argument
    if isinstance(error, cyclopts.MissingArgumentError) and argument and not error.tokens_so_far:
        named = getattr(error, "keyword", None) or next(
            (token.keyword for token in argument.tokens if token.keyword), None
        )
        name = argument.name.removeprefix("--").upper() if argument.field_info.is_positional else argument.name
        text = (argument.parameter.help or "").rstrip(".")
        words = f"{named} needs a value" if named else f"{name} is missing"
        return f"{words}{f': {text[:1].lower()}{text[1:]}' * bool(text)}"
    return str(error)


def _help_of(arguments: list[str]) -> str:
    """The command that explains the verb, or all verbs when there is no such verb."""
    named = arguments[:2] if arguments[:1] == ["profile"] else arguments[:1]
    known = ({*app}, {*hardware.profile_app})
    verbs = [word for word, there in zip(named, known, strict=False) if word in there]
    return " ".join(["rig", *verbs, "--help"])
