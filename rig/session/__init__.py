"""Sessions: the folder, its journal, its lock, and steps that go on where they stopped."""

from rig.session.ledger import FrameDetails
from rig.session.step import Step
from rig.session.store import Session

__all__ = ["FrameDetails", "Session", "Step"]
