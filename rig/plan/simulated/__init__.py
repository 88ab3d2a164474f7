"""What ``rig simulate --output`` writes: a picture, brightness by wall, a mesh with its light, and a page."""
