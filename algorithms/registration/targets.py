"""Registration by survey targets that two stations have in common (Lichtenstein 2011; Haring 2003)."""

from dataclasses import dataclass
from typing import ClassVar, final

from algorithms.registration.method import Method


@final
@dataclass(frozen=True)
class TargetsMethod(Method):
    """Survey targets alone: at least three in common, by their names or their distances.

    They are those that the stations state and those that are found in the scans. Gross errors are left out one at a
    time. The surfaces only judge: where they overlap they must not contradict.
    """

    name: ClassVar[str] = "targets"
    work: ClassVar[str] = "algorithms.registration.target_registration:register_by_targets"
