"""Digital still cameras, over the library gphoto2."""
