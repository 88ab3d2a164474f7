"""What boards cannot tell of lenses, refused with its cause."""
