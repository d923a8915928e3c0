"""Counts that outlive processes, for Prometheus."""

from collections.abc import Mapping

import sqlalchemy as sa
from sqlalchemy.dialects import postgresql, sqlite

from service.adapters.database.tables import totals

LABEL_LETTERS = 64


def add_to_totals(connection: sa.Connection, amounts: Mapping[tuple[str, str], float]) -> None:
    """Add amounts, by name and label, to what was counted so far."""
    insert = postgresql.insert if connection.dialect.name == "postgresql" else sqlite.insert
    # always in the same order, so that two transactions never wait for each other
    for name, label in sorted(amounts):
        row = insert(totals).values(name=name, label=label[:LABEL_LETTERS], value=amounts[name, label])
        grown = {"value": totals.c.value + row.excluded.value}
        connection.execute(row.on_conflict_do_update(index_elements=[totals.c.name, totals.c.label], set_=grown))


def read_totals(connection: sa.Connection) -> Mapping[str, Mapping[str, float]]:
    """Give what was counted, by name and label."""
    found: dict[str, dict[str, float]] = {}
    for row in connection.execute(sa.select(totals)):
        found.setdefault(row.name, {})[row.label] = row.value
    return found
