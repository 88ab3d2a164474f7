"""Pictures by pixel that steps hand on: samples of them, and where lenses are sharp."""
