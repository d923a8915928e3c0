"""Iterative closest points after Horn, Besl and McKay, and Hofer and Pottmann."""
