"""Scan to scan: every method in a file of its own, all of them in one union."""

from algorithms.registration.icl import IclMethod
from algorithms.registration.lines import LinesMethod
from algorithms.registration.lines_alshawa import LinesAlshawaMethod
from algorithms.registration.lines_compat import LinesCompatMethod

RegistrationMethod = LinesMethod | LinesCompatMethod | LinesAlshawaMethod | IclMethod
"""All methods, `A | B | ...`; validation, documentation and dispatch follow from it."""

DEFAULT_METHOD = LinesMethod
"""What `auto` stands for."""
