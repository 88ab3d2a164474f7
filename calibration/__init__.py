"""From captured arrays to calibrated ones: no device, no file, no terminal; does not know `sim`."""
