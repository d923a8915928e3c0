"""Make the table of callbacks; let jobs have a subscriber, and files to fetch."""

import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision = "0003"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Create the table and the columns."""
    op.add_column("jobs", sa.Column("subscriber", sa.JSON))
    op.add_column("jobs", sa.Column("fetches", sa.JSON))
    op.create_table(
        "callbacks",
        sa.Column("job_id", sa.String(64), sa.ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True),
        sa.Column("event", sa.String(16), primary_key=True),
        sa.Column("uri", sa.Text, nullable=False),
        sa.Column("host", sa.String(255), nullable=False),
        sa.Column("due", sa.Float, index=True),
        sa.Column("claimed_by", sa.String(128)),
        sa.Column("attempts", sa.Integer, nullable=False),
        sa.Column("delivered", sa.Integer, nullable=False),
        sa.Column("told", sa.DateTime(timezone=True)),
    )


def downgrade() -> None:
    """Drop them."""
    op.drop_table("callbacks")
    op.drop_column("jobs", "fetches")
    op.drop_column("jobs", "subscriber")
