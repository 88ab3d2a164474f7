"""Live compensation: sources of pictures, the newest of them compensated once a refresh, and shown on time."""
