"""An emulated USB video camera."""
