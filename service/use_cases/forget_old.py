"""Forget what has been kept long enough."""

from dataclasses import dataclass
from datetime import datetime, timedelta

from service.ports import KEPT_ANSWERS, AuditLog, IdempotencyStore


@dataclass(frozen=True)
class Forgotten:
    """How much was forgotten."""

    audit_entries: int
    answers: int

    @property
    def nothing(self) -> bool:
        """Tell whether nothing was old enough."""
        return not (self.audit_entries or self.answers)


def forget_old(audit: AuditLog, answers: IdempotencyStore, audit_days: int, now: datetime) -> Forgotten:
    """Remove old entries of the audit log, and answers that are given again no more."""
    return Forgotten(audit.forget_before(now - timedelta(days=audit_days)), answers.forget_before(now - KEPT_ANSWERS))
