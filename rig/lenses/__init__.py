"""`rig lenses`: photographs of boards, or lists of their corners, to a lens file and its page."""
