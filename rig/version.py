"""Which version of procam-rig this is."""

from importlib.metadata import version

__version__ = version("procam-rig")
"""As it was installed; every session and every report has it."""
