"""Let it be known how much was computed of files and is kept beside them."""

import sqlalchemy as sa
from alembic import op

revision = "0011"
down_revision = "0010"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Create the column; what was computed before counts as soon as a job uses the file again."""
    op.add_column("files", sa.Column("computed_bytes", sa.BigInteger, nullable=False, server_default="0"))


def downgrade() -> None:
    """Drop it."""
    op.drop_column("files", "computed_bytes")
