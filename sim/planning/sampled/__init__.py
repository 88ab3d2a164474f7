"""Patches for form factors by rays."""
