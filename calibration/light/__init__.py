"""What light does in the room: direct and global parts, vignetting, reflectance."""
