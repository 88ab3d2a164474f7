"""The parts of the self-check, one file each."""
