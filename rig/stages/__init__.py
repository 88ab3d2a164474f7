"""The stages of a session, one file each: from photographs to a comparison of measured and simulated light."""
