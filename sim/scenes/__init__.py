"""A library of scenes of which much is known exactly."""
