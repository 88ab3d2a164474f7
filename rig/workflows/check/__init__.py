"""Self-test of a rig: what calibration takes for granted, measured. Verb `check`."""

from rig.workflows.check.run import PARTS, run_check

__all__ = ["PARTS", "run_check"]
