"""The stripes of a structured-light code: read from frames, and as wide as the lenses resolve."""
