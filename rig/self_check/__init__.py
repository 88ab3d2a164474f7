"""Self-test of a rig: what calibration takes for granted, measured. Verb `check`."""

from rig.self_check.run import PARTS, run_check

__all__ = ["PARTS", "run_check"]
