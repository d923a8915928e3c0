"""Let it be known how much is stored of the results of each job."""

import sqlalchemy as sa
from alembic import op

revision = "0007"
down_revision = "0006"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Create the column; what there is already is counted when the service cleans up."""
    op.add_column("jobs", sa.Column("result_bytes", sa.BigInteger))
    op.create_index("ix_jobs_owner_result_bytes", "jobs", ["owner", "result_bytes"])
    op.create_index("ix_jobs_result_bytes", "jobs", ["result_bytes"])


def downgrade() -> None:
    """Drop it."""
    op.drop_index("ix_jobs_result_bytes", "jobs")
    op.drop_index("ix_jobs_owner_result_bytes", "jobs")
    op.drop_column("jobs", "result_bytes")
