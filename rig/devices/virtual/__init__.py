"""A display that is a piece of memory: for emulated rigs on machines without a display."""
