"""A still camera whose pictures are rendered from the simulated world at each release of the shutter."""
