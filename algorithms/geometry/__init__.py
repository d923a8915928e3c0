"""Closed forms and value types."""
