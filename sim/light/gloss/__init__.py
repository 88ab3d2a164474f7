"""Gloss beside the matte reflection of patches: rough lobes in first, middle and last bounce."""
