"""Lenses, poses, points and walls."""
