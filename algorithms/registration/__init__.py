"""Scan to scan: every method in a file of its own, all of them in one union."""

from algorithms.registration.lines import LinesMethod

RegistrationMethod = LinesMethod
"""All methods, `A | B | ...`; validation, documentation and dispatch follow from it."""

DEFAULT_METHOD = LinesMethod
"""What `auto` stands for."""
