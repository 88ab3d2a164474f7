"""The terminal: progress and tables (names below), keys as they are pressed, signals that ask to end."""

from rig.terminal.output import OnStep, TerminalProgress, in_percent, part_of, silent
from rig.terminal.sentences import say
from rig.terminal.tables import print_table

__all__ = ["OnStep", "TerminalProgress", "in_percent", "part_of", "print_table", "say", "silent"]
