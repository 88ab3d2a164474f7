"""The simulated world and the camera and the projector in it."""
