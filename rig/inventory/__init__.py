"""What is plugged in, and the profile that it makes."""
