"""Let jobs remember which of their outputs are wanted, and in which form."""

import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision = "0004"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Create the column."""
    op.add_column("jobs", sa.Column("wanted", sa.JSON))


def downgrade() -> None:
    """Drop it."""
    op.drop_column("jobs", "wanted")
