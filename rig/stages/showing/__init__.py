"""Where pictures are wanted in a measured room, and what stays dark in it."""
