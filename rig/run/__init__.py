"""The one orchestration of a session, used by the command line and by scripts."""
