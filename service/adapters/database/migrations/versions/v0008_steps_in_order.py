"""Keep the steps of jobs with all that is needed to compute them in order, and counts of what was computed."""

import sqlalchemy as sa
from alembic import op

revision = "0008"
down_revision = "0007"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Make the tables anew; jobs that are under way are begun again."""
    op.drop_table("job_steps")
    op.create_table(
        "job_steps",
        sa.Column("job_id", sa.String(64), sa.ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True),
        sa.Column("stage", sa.Integer, primary_key=True),
        sa.Column("position", sa.Integer, primary_key=True),
        sa.Column("weight", sa.Float, nullable=False),
        sa.Column("fraction", sa.Float, nullable=False),
        sa.Column("name", sa.String(64), nullable=False),
        sa.Column("arguments", sa.JSON, nullable=False),
        sa.Column("label", sa.Text, nullable=False),
        sa.Column("state", sa.String(16), nullable=False),
        sa.Column("executor", sa.String(128)),
        sa.Column("waiting_since", sa.Float, nullable=False),
        sa.Column("begun", sa.Float),
        sa.Column("ended", sa.Float),
        sa.Column("deaths", sa.Float, nullable=False),
        sa.Column("output", sa.JSON),
    )
    op.create_index("ix_job_steps_state", "job_steps", ["state", "job_id"])
    op.add_column("jobs", sa.Column("planned", sa.Integer, nullable=False, server_default="0"))
    op.create_index("ix_jobs_planned_status", "jobs", ["planned", "status", "owner", "urgency", "created"])
    op.create_table(
        "turns", sa.Column("owner", sa.String(64), primary_key=True), sa.Column("begun", sa.Float, nullable=False)
    )
    op.create_table(
        "totals",
        sa.Column("name", sa.String(64), primary_key=True),
        sa.Column("label", sa.String(64), primary_key=True),
        sa.Column("value", sa.Float, nullable=False),
    )
    op.add_column("executors", sa.Column("launcher_pid", sa.Integer))
    op.add_column("executors", sa.Column("launcher_started", sa.Float))


def downgrade() -> None:
    """Leave the steps to be begun again."""
    op.drop_column("executors", "launcher_started")
    op.drop_column("executors", "launcher_pid")
    op.drop_table("totals")
    op.drop_table("turns")
    op.drop_index("ix_jobs_planned_status", "jobs")
    op.drop_column("jobs", "planned")
    op.drop_table("job_steps")
    op.create_table(
        "job_steps",
        sa.Column("job_id", sa.String(64), sa.ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True),
        sa.Column("stage", sa.Integer, primary_key=True),
        sa.Column("position", sa.Integer, primary_key=True),
        sa.Column("weight", sa.Float, nullable=False),
        sa.Column("fraction", sa.Float, nullable=False),
    )
