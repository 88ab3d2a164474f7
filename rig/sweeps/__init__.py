"""`rig sweep`: a study's points, each asked once, on this machine or on a cluster."""
