"""A package that adds a camera, a projector, a strategy and a code to procam-rig."""
