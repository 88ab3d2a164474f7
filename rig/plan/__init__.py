"""A room planned before it is built: brightness, contrast, interreflection and what compensation is worth."""
