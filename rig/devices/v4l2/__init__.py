"""Cameras of the Linux kernel's V4L2: found by what they are, asked by ioctl, checked by reading back."""
