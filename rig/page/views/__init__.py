"""What the page shows of sessions: lists, pictures, scenes; read from the folders that `rig` writes."""
