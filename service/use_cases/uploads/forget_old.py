"""Forget what has been kept long enough."""

from dataclasses import dataclass
from datetime import datetime, timedelta

from service.ports import KEPT_ANSWERS, AuditLog, IdempotencyStore, SessionStore

REFUSALS = frozenset({401, 403, 429})
"""Answers to those who were turned away; anybody can cause as many as he likes."""


@dataclass(frozen=True)
class Forgotten:
    """How much was forgotten."""

    audit_entries: int
    answers: int
    sessions: int

    @property
    def nothing(self) -> bool:
        """Tell whether nothing was old enough."""
        return not (self.audit_entries or self.answers or self.sessions)


def forget_old(
    audit: AuditLog,
    answers: IdempotencyStore,
    sessions: SessionStore,
    audit_days: int,
    now: datetime,
    refused_days: int | None = None,
) -> Forgotten:
    """Remove old entries of the audit log, those of refusals sooner, and what is neither given nor asked for again."""
    entries = audit.forget_before(now - timedelta(days=audit_days))
    if refused_days is not None:
        entries += audit.forget_before(now - timedelta(days=refused_days), REFUSALS)
    return Forgotten(entries, answers.forget_before(now - KEPT_ANSWERS), sessions.forget_before(now))
