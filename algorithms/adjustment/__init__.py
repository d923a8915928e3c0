"""Least squares with testing and reliability."""
