"""The measured surface to look at: in three dimensions, from above, as a file that other programs open."""
