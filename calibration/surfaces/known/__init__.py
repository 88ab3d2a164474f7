"""A surface that is known beforehand, a CAD model or a scan, found in what a camera sees of it."""
