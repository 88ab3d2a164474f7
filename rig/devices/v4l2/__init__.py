"""Cameras of Linux's video API (V4L2), by its own ioctls."""
