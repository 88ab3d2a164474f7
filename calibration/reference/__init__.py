"""Slow definitions of what the native kernel does, in numpy: the tests hold the kernel to them."""
