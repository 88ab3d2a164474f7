"""Files: one reader and one writer of each kind."""
