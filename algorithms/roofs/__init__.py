"""Roofs of buildings from points over their ground plans."""
