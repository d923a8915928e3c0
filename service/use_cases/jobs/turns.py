"""Whose turn it is: which of the waiting steps is computed next.

First comes the project that has the fewest steps running, and of several the one that was served longest ago: whatever
one project sends, another's first step begins when the next computation ends. Within a project the urgent jobs come
first; then later stages before earlier ones, so that what was begun is finished, and a job ends long before all have;
then the older job. A step that was interrupted by the end of its worker lets the others by for a while: it may be the
cause, and if it is not, it should not be the one that the next interruption finds again.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import datetime

HELD_BACK_S = 60.0
"""How long an interrupted step lets others by."""


@dataclass(frozen=True)
class ProjectShare:
    """What one project has of the workers."""

    owner: str
    running: int
    """Steps that are being computed."""
    begun: float
    """When a step of it was begun last; 0: never."""


@dataclass(frozen=True)
class WaitingPlace:
    """Where a step, or a job that is not begun, stands among those of its project."""

    urgency: int
    """0 (first) to 7 (last)."""
    stage: int
    created: datetime
    """When the job was sent."""
    job_id: str
    index: int = 0
    held_back: bool = False
    """Its worker died not long ago."""


def in_turn(shares: Iterable[ProjectShare]) -> Sequence[str]:
    """Order projects, the one whose turn it is first."""
    return [share.owner for share in sorted(shares, key=lambda share: (share.running, share.begun, share.owner))]


def before(one: WaitingPlace, other: WaitingPlace) -> bool:
    """Tell whether a step comes before another one of the same project."""
    return _key(one) < _key(other)


def _key(place: WaitingPlace) -> tuple[int, bool, int, datetime, str, int]:
    return place.urgency, place.held_back, -place.stage, place.created, place.job_id, place.index
