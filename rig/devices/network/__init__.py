"""Projectors that are controlled over the network (PJLink)."""
