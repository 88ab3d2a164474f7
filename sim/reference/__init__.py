"""Slow and readable definitions that tests hold the native kernel to."""
