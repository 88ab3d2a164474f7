"""Recordings in the place of the devices."""
