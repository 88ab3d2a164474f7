"""Work without any rig: simulations of scenes, and scans from photographs."""
