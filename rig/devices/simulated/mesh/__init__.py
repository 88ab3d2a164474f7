"""The simulated world of any mesh: matte and glossy facets, shadows, and the light that they exchange."""
