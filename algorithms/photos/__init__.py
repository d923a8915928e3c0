"""From pixels to straight 2-D edges."""
