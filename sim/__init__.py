"""The reference model of interreflection: arrays in, arrays out; no device, no file, no terminal."""
