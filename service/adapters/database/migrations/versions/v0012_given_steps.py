"""Let Procrastinate give steps to workers, on PostgreSQL: its tables, and where each job stands in the order."""

from importlib.resources import files

import sqlalchemy as sa
from alembic import op

revision = "0012"
down_revision = "0011"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Create them; whatever waits is offered by the first worker that is given its steps."""
    op.add_column("jobs", sa.Column("turn", sa.BigInteger))
    if op.get_bind().dialect.name == "postgresql":
        # of the version that uv.lock names; a later one comes with a revision that runs its migrations
        schema = (files("procrastinate.sql") / "schema.sql").read_text(encoding="utf-8")
        # many statements at once, which only the driver takes
        op.get_bind().connection.driver_connection.execute(schema)  # type: ignore[union-attr]


def downgrade() -> None:
    """Drop them; steps that wait are there as before."""
    op.drop_column("jobs", "turn")
    if op.get_bind().dialect.name == "postgresql":
        for table in ("periodic_defers", "events", "jobs", "workers"):
            op.execute(f"DROP TABLE procrastinate_{table} CASCADE")
        op.execute(
            """
            DO $$ DECLARE routine regprocedure; BEGIN
                FOR routine IN SELECT oid FROM pg_proc WHERE proname LIKE 'procrastinate\\_%' LOOP
                    EXECUTE 'DROP FUNCTION ' || routine || ' CASCADE';
                END LOOP;
            END $$
            """
        )
        for kind in ("job_to_defer_v1", "job_status", "job_event_type"):
            op.execute(f"DROP TYPE procrastinate_{kind} CASCADE")
