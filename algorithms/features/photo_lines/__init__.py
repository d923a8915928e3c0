"""Edges of photos carried into space and merged with the scan's lines."""
