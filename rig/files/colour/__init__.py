"""Colours of picture files: what a file says of its numbers, and the way from there to the linear light of sRGB."""
