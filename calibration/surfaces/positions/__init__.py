"""One surface seen from several positions of a camera: placed by what all saw, compared, put together."""
