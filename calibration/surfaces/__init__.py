"""Surfaces of any form, from what a camera sees of a projector's light."""
