"""USB beside the kernel's camera driver: who is there, resets, vendor controls."""
