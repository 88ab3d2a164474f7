"""The picture that a camera takes of a scene."""
