"""An emulated USB device, plugged into this machine's own kernel."""
