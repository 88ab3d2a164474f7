"""Hardware profiles, and what public documents say of cameras and projectors."""
