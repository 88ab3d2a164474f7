"""Every strategy beside the others, measured on the rig."""
