"""Work on the rig, one job at a time, each in a process of its own: a page can neither slow nor crash it."""
