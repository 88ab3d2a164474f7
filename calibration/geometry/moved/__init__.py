"""Which device of a calibrated pair was turned or moved since, and by how much."""
