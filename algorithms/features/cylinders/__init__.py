"""Cylinders of a scan and their axes."""
