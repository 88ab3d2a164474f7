"""A library of scenes for the simulated world, made by own code: ``scene = "furnished"`` and others."""
