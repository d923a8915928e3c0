"""Calibration of cameras and of their mounts on scanners."""
