"""A GigE Vision camera on this machine's network that looks at the simulated world."""
