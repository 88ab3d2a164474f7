"""Corners of boards in pictures: which belong together, what part of a board is seen, and where exactly each is."""
