"""Lenses from pictures of boards: a camera, and a projector that lights the boards, in one bundle adjustment."""
