"""Covariances of patches of surface."""
