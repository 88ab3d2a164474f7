"""Display outputs of Linux's mode setting API (DRM/KMS), by its own ioctls; no desktop."""
