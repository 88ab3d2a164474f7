"""The show: frames from the mailbox, compensated, on screen on time."""
