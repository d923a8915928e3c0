"""Statuses of registered pairs, as documents name them."""

IN_PLACE = ("accepted", "coarse")
"""Of poses that are certainly the right ones: they tie networks, are exported, carry control."""
STATUSES = (*IN_PLACE, "doubtful", "ambiguous", "degenerate", "rejected")
"""All, the most promising first."""
