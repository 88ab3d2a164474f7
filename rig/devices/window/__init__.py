"""A window that fills one monitor of a desktop (X11, Wayland)."""
