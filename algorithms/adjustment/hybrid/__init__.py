"""Hybrid networks of scans, photos, control and fictitious observations in one sparse adjustment (MATH 6)."""
