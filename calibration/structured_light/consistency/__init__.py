"""Whether photographs of a code are what they are called, from the photographs themselves."""
