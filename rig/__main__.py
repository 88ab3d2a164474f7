"""Entry of the command `rig` and of `python -m rig`: what concerns the process and not one command."""

import io
import os
import resource
import signal
import sys

_LEAST_STACK_BYTES = 1 << 20
"""With less, libraries that draw, decode and solve crash without a word; 8 MiB is what systems give."""
_USUAL_STACK_BYTES = 8 << 20


def main() -> None:
    """Run the command line of this process, and end it."""
    _open_standard_streams()
    # Kernel threads that spin while they wait take the cores from numpy's and OpenCV's, and from the cameras'.
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")
    # Numpy's threads, too, which spin for 25 ms after each product else (2^26 cycles; this is 2^4).
    os.environ.setdefault("OPENBLAS_THREAD_TIMEOUT", "4")
    status = _with_usual_stack() or _status(sys.argv[1:])
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # it has ended: nothing is left to interrupt
    sys.exit(status)


def _open_standard_streams() -> None:
    """Whoever closed a standard stream wants to hear nothing; a file that is opened later must not get its number."""
    for number, name, mode in ((0, "stdin", "r"), (1, "stdout", "w"), (2, "stderr", "w")):
        try:
            os.fstat(number)
        except OSError:
            opened = os.open(os.devnull, os.O_RDWR)
            if opened != number:
                os.dup2(opened, number)
                os.close(opened)
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(number, mode, closefd=False))
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # a file's name need not be text; stderr does so already


def _with_usual_stack() -> int:
    """Start this process again where it was given a tiny stack; 2 where it may not have a larger one, else 0."""
    soft, hard = resource.getrlimit(resource.RLIMIT_STACK)
    if soft == resource.RLIM_INFINITY or soft >= _LEAST_STACK_BYTES:
        return 0
    try:
        larger = _USUAL_STACK_BYTES if hard == resource.RLIM_INFINITY else max(hard, _LEAST_STACK_BYTES)
        resource.setrlimit(resource.RLIMIT_STACK, (larger, hard if hard == resource.RLIM_INFINITY else larger))
    except (ValueError, OSError):
        print(
            f"rig: the stack may have {hard >> 10} KiB, the least is {_LEAST_STACK_BYTES >> 10} KiB; run `ulimit -s "
            f"{_USUAL_STACK_BYTES >> 10}` in a new shell, or raise the limit that the system gives",
            file=sys.stderr,
        )
        return 2
    os.execv(sys.executable, [sys.executable, *sys.orig_argv[1:]])


def _status(arguments: list[str]) -> int:
    try:
        from rig.cli.app import run_command  # here, so that Ctrl-C during the import is quiet too
        from rig.terminal.plain import write_plainly

        write_plainly()
        status = _printed(run_command(arguments))
    except KeyboardInterrupt:
        print("rig: interrupted; nothing is lost, run the same command again to go on", file=sys.stderr)
        return 130
    except BrokenPipeError:  # whoever reads the result has seen enough
        _drop_output()
        return 0
    except SystemExit as end:  # a table that met a closed pipe ends the process like that
        if not isinstance(end.__context__, BrokenPipeError):
            raise
        _drop_output()
        return 0
    return status


def _printed(status: int) -> int:
    """Return the status, or 4 when the result cannot be printed to its end; one line tells what went wrong first."""
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        raise
    except OSError as error:
        _drop_output()
        if status in (0, 1):
            print(f"rig: {error}; check the disk, then run the same command again", file=sys.stderr)
            return 4
    return status


def _drop_output() -> None:
    """What is still to be printed would fail again when the interpreter ends."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


if __name__ == "__main__":
    main()
