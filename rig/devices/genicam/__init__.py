"""Cameras of GigE Vision and USB3 Vision, over the library Aravis."""
