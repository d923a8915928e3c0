"""Whom a job tells of its end, and how."""
