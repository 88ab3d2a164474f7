"""A camera that is not there, plugged into this machine's real kernel, and the room that it sees."""
