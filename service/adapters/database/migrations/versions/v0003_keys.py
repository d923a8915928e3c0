"""Make the tables of keys, of the audit log and of idempotent requests; give files and jobs to projects.

What was there before belongs to the default project, whose name is empty.
"""

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"
branch_labels = None
depends_on = None

TIME = sa.DateTime(timezone=True)
OWNED = ("files", "jobs")


def upgrade() -> None:
    """Create the tables and columns."""
    for table in OWNED:
        op.add_column(table, sa.Column("owner", sa.String(64), nullable=False, server_default=""))
        op.create_index(f"ix_{table}_owner_created", table, ["owner", "created"])
    op.add_column("jobs", sa.Column("urgency", sa.Integer, nullable=False, server_default="3"))
    op.add_column("jobs", sa.Column("request_id", sa.String(128), nullable=False, server_default=""))
    op.create_table(
        "keys",
        sa.Column("id", sa.String(32), primary_key=True),
        sa.Column("name", sa.String(64), nullable=False),
        sa.Column("project", sa.String(64), nullable=False),
        sa.Column("scopes", sa.JSON, nullable=False),
        sa.Column("hash", sa.String(200), nullable=False),
        sa.Column("created", TIME, nullable=False),
        sa.Column("expires", TIME),
        sa.Column("revoked", TIME),
        sa.Column("last_used", TIME),
    )
    op.create_table(
        "audit",
        # SQLite numbers rows by itself only when the key is its own INTEGER
        sa.Column("id", sa.BigInteger().with_variant(sa.Integer, "sqlite"), primary_key=True, autoincrement=True),
        sa.Column("time", TIME, nullable=False, index=True),
        sa.Column("key_id", sa.String(32), nullable=False),
        sa.Column("project", sa.String(64), nullable=False),
        sa.Column("remote", sa.String(64), nullable=False),
        sa.Column("method", sa.String(16), nullable=False),
        sa.Column("path", sa.Text, nullable=False),
        sa.Column("status", sa.Integer, nullable=False),
        sa.Column("request_id", sa.String(128), nullable=False),
    )
    op.create_table(
        "idempotency",
        sa.Column("owner", sa.String(64), primary_key=True),
        sa.Column("key", sa.String(255), primary_key=True),
        sa.Column("created", TIME, nullable=False, index=True),
        sa.Column("seed", sa.String(32), nullable=False),
        sa.Column("holder", sa.String(32), nullable=False),
        sa.Column("held_until", sa.Float, nullable=False),
        sa.Column("fingerprint", sa.String(64)),
        sa.Column("status", sa.Integer),
        sa.Column("headers", sa.JSON),
        sa.Column("body", sa.LargeBinary),
    )


def downgrade() -> None:
    """Drop them."""
    for name in ("idempotency", "audit", "keys"):
        op.drop_table(name)
    for column in ("request_id", "urgency", "owner"):
        if column == "owner":
            op.drop_index("ix_jobs_owner_created", "jobs")
        op.drop_column("jobs", column)
    op.drop_index("ix_files_owner_created", "files")
    op.drop_column("files", "owner")
