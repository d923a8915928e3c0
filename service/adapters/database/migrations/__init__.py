"""Migrations of the metadata database (alembic)."""
