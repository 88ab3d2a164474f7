"""Designs of a room: free parameters, goals, the best of them, and why."""
