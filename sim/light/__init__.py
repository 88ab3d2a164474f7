"""Radiosity and light transport, grey and in colour."""
