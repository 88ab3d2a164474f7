"""The DLP LightCrafter 4500 over USB HID."""
