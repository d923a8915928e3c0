"""How urgent a request says that its job is: the header Priority (RFC 9218)."""

import re

from service.ports import USUAL_URGENCY

URGENCY = re.compile(r"(?:^|,)\s*u\s*=\s*([0-7])\s*(?=$|,|;)")


def urgency_of(priority: str | None) -> int:
    """Give the urgency, 0 (first) to 7 (last); what is missing or cannot be read means the usual one (section 4)."""
    given = URGENCY.findall(priority or "")
    return int(given[-1]) if given else USUAL_URGENCY
