"""What a rig is made of: protocols, the simulated pair on its world, replay of recordings."""
