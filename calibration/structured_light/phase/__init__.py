"""Codes of sinusoids: a pixel's phase, and which period it is in."""
