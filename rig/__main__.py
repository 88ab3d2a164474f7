"""Entry of the command `rig` and of `python -m rig`: quiet when it is interrupted while it still starts."""

import signal
import sys


def main() -> None:
    """Run the command line of this process."""
    try:
        from rig.cli import run_command

        status = run_command(sys.argv[1:])
    except KeyboardInterrupt:
        print("rig: interrupted; nothing is lost, run the same command again to go on", file=sys.stderr)
        status = 130
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # it has ended: nothing is left to interrupt
    sys.exit(status)


if __name__ == "__main__":
    main()
