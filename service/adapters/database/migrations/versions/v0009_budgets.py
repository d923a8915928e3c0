"""Let it be known how much a project has in the database."""

import sqlalchemy as sa
from alembic import op

revision = "0009"
down_revision = "0008"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Create the column, with the size of the inputs that there are, and the indices."""
    op.add_column("jobs", sa.Column("input_bytes", sa.BigInteger, nullable=False, server_default="0"))
    op.execute("UPDATE jobs SET input_bytes = length(CAST(inputs AS TEXT))")
    op.create_index("ix_jobs_owner_input_bytes", "jobs", ["owner", "input_bytes"])
    op.create_index("ix_audit_project", "audit", ["project"])


def downgrade() -> None:
    """Drop them."""
    op.drop_index("ix_audit_project", "audit")
    op.drop_index("ix_jobs_owner_input_bytes", "jobs")
    op.drop_column("jobs", "input_bytes")
