"""From digital numbers to linear light."""
