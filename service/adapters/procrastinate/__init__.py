"""Workers that Procrastinate gives their steps, from PostgreSQL."""
