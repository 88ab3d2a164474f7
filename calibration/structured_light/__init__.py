"""Patterns, and how pixels are read back from photographs of them."""
