"""Run by alembic; the connection comes from `service.adapters.database.migrate`."""

from alembic import context

from service.adapters.database.tables import metadata

connection = context.config.attributes["connection"]
context.configure(connection=connection, target_metadata=metadata)
with context.begin_transaction():
    context.run_migrations()
