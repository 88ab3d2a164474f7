"""What light does in the measured room, and what it tells of walls that nobody saw."""
