"""What the light falls on: the walls of a room, and what stands before them."""
