"""What the service keeps of browsers' sessions: with what they are sealed, and which were ended."""

from datetime import datetime
from typing import Protocol


class SessionStore(Protocol):
    """Keep the secret of sessions, the same for all processes, and the sessions that were ended before their time."""

    def secret(self) -> bytes:
        """Give the random bytes with which sessions are sealed; they are made when they are asked for first."""

    def end(self, session_id: str, until: datetime) -> None:
        """Note that a session is over, until it would have run out by itself."""

    def has_ended(self, session_id: str) -> bool:
        """Tell whether a session was ended."""

    def forget_before(self, moment: datetime) -> int:
        """Forget sessions that would have run out by then; give their number."""
