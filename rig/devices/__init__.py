"""What a rig is made of: protocols, the simulated pair on its bench, replay of recordings."""
