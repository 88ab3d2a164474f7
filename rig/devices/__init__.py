"""What a rig is made of: protocols, simulated devices in their world, replay of recordings."""
