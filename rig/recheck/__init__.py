"""`rig recheck`: in under a minute, whether a session's rig still stands where it was calibrated."""
