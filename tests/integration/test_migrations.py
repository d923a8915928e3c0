"""Databases of every earlier version are brought up to date with what they hold, on each database."""

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

import alembic.command
import alembic.config
import pytest
import sqlalchemy as sa
from alembic.script import ScriptDirectory

from service.adapters.database import DatabaseJobStore, migrate
from service.adapters.database_files import DatabaseFileStore
from service.adapters.database_tables import connect, metadata
from service.ports import JobFilter, JobStatus
from service.settings import Settings
from tests.databases import NewDatabase

MIGRATIONS = Path(__file__).parents[2] / "service" / "adapters" / "migrations"
NOW = datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC)
JOB = {
    "id": "j1",
    "process_id": "register",
    "inputs": {"a": 1},
    "status": "running",
    "created": NOW,
    "progress": 40,
    "message": "half",
    "attempts": 1,
}
FILE = {
    "id": "f1",
    "name": "a.e57",
    "bytes": 5_000_000_000,
    "sha256": "0" * 64,
    "format": "e57",
    "kind": "scan",
    "created": NOW,
    "scans": [{"index": 0}],
    "photos": [],
}


def configuration() -> alembic.config.Config:
    made = alembic.config.Config()
    made.set_main_option("script_location", str(MIGRATIONS))
    return made


def revisions() -> Sequence[str]:
    """List all versions, oldest first."""
    scripts = ScriptDirectory.from_config(configuration())
    return [script.revision for script in scripts.walk_revisions()][::-1]


def columns(tables: sa.MetaData) -> set[tuple[str, str, bool]]:
    return {(table.name, each.name, bool(each.nullable)) for table in tables.tables.values() for each in table.columns}


@pytest.mark.parametrize("version", revisions())
def test_a_database_of_an_earlier_version_is_brought_up_to_date_with_what_it_holds(
    tmp_path: Path, new_database: NewDatabase, version: str
) -> None:
    settings = Settings(data_dir=tmp_path, database_url=new_database())
    engine = connect(settings)
    at_version = configuration()
    with engine.begin() as connection:
        at_version.attributes["connection"] = connection
        alembic.command.upgrade(at_version, version)
        # by today's tables, which know the types of the columns
        connection.execute(metadata.tables["jobs"].insert().values(JOB))
        connection.execute(metadata.tables["files"].insert().values(FILE))
    migrate(settings)
    found = sa.MetaData()
    found.reflect(engine)
    jobs, number = DatabaseJobStore(engine, lambda *_: None).find(JobFilter())
    file = DatabaseFileStore(engine).get("f1")
    engine.dispose()
    assert columns(found) - columns(metadata) == {("alembic_version", "version_num", False)}
    assert columns(metadata) - columns(found) == set()
    assert (number, jobs[0].status, jobs[0].inputs, jobs[0].created) == (1, JobStatus.RUNNING, {"a": 1}, NOW)
    assert file is not None
    assert (file.bytes, file.scans) == (5_000_000_000, ({"index": 0},))
