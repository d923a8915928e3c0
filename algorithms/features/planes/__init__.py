"""Planes of a scan, their boundaries and intersections."""
