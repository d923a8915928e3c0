"""The ports' stores in a database (SQLite or PostgreSQL)."""
