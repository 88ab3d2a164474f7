"""Frames of a live show, compensated in one native call."""
