"""Entry of the command `rig` and of `python -m rig`: what concerns the process and not one command."""

import os
import signal
import sys


def main() -> None:
    """Run the command line of this process, and end it."""
    # Kernel threads that spin while they wait take the cores from numpy's and OpenCV's, and from the cameras'.
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")
    status = _status(sys.argv[1:])
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # it has ended: nothing is left to interrupt
    sys.exit(status)


def _status(arguments: list[str]) -> int:
    try:
        from rig.cli.app import run_command  # here, so that Ctrl-C during the import is quiet too

        status = run_command(arguments)
        sys.stdout.flush()
    except KeyboardInterrupt:
        print("rig: interrupted; nothing is lost, run the same command again to go on", file=sys.stderr)
        return 130
    except BrokenPipeError:  # whoever reads the result has seen enough
        _drop_output()
        return 0
    except OSError as error:  # a disk or a file that refuses
        _drop_output()
        print(f"rig: {error}; check the disk, then run the same command again", file=sys.stderr)
        return 4
    return status


def _drop_output() -> None:
    """What is still to be printed would fail again when the interpreter ends."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


if __name__ == "__main__":
    main()
