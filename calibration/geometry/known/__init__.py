"""Lenses that somebody measured before: what is known of them, and whether the points agree."""
