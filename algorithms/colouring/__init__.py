"""Colours of points from the photos of all stations, and edges of photos as outlines on planes."""
