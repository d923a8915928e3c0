"""Databases of every earlier version are brought up to date with what they hold, on each database."""

import os
import subprocess
import sys
import warnings
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

import alembic.command
import alembic.config
import pytest
import sqlalchemy as sa
from alembic.script import ScriptDirectory

from service.adapters.database.files import DatabaseFileStore
from service.adapters.database.jobs import DatabaseJobStore, migrate
from service.adapters.database.tables import connect, metadata
from service.ports import JobFilter, JobStatus
from service.settings import Settings
from tests.servers.databases import NewDatabase
from tests.servers.postgres_server import PostgresServer

MIGRATIONS = Path(__file__).parents[2] / "service" / "adapters" / "database" / "migrations"
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
    ours = [table for table in tables.tables.values() if not table.name.startswith("procrastinate_")]
    return {(table.name, each.name, bool(each.nullable)) for table in ours for each in table.columns}


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
    with warnings.catch_warnings():  # of the library's own types
        warnings.simplefilter("ignore", sa.exc.SAWarning)
        found.reflect(engine)
    store = DatabaseJobStore(engine)
    _, number = store.find(JobFilter())
    job = store.whole(str(JOB["id"]))
    file = DatabaseFileStore(engine).get("f1")
    engine.dispose()
    assert columns(found) - columns(metadata) == {("alembic_version", "version_num", False)}
    assert columns(metadata) - columns(found) == set()
    assert job is not None
    assert (number, job.status, job.inputs, job.created) == (1, JobStatus.RUNNING, {"a": 1}, NOW)
    assert file is not None
    assert (file.bytes, file.scans) == (5_000_000_000, ({"index": 0},))


@pytest.mark.service
def test_machines_that_start_at_the_same_time_make_the_tables_once(postgres: PostgresServer, tmp_path: Path) -> None:
    environment = {**os.environ, "TIELINE_DATABASE_URL": postgres.new_database()}
    command = [sys.executable, "-c", "from service.__main__ import app; app()", "migrate"]
    machines = [
        subprocess.Popen(
            command, env={**environment, "TIELINE_DATA_DIR": str(tmp_path / str(k))}, stderr=subprocess.PIPE
        )
        for k in range(4)
    ]
    ends = [(machine.communicate()[1][-2000:], machine.returncode) for machine in machines]
    assert [code for _, code in ends] == [0] * 4, ends


@pytest.mark.service
def test_a_database_that_is_away_is_named_without_its_password(tmp_path: Path) -> None:
    url = "postgres://somebody:secret@127.0.0.1:1/tieline"
    command = [sys.executable, "-c", "from service.__main__ import app; app()", "migrate"]
    environment = {**os.environ, "TIELINE_DATABASE_URL": url, "TIELINE_DATA_DIR": str(tmp_path)}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    said = " ".join(done.stderr.split())
    assert done.returncode == 3
    assert "the database postgresql+psycopg://somebody:***@127.0.0.1:1/tieline cannot be used" in said
    assert "secret" not in said


@pytest.mark.service
def test_the_tables_of_procrastinate_are_those_of_its_version_and_go_without_a_trace(
    tmp_path: Path, postgres: PostgresServer
) -> None:
    settings = Settings(data_dir=tmp_path, database_url=postgres.new_database())
    migrate(settings)
    engine = connect(settings)
    made = routines(engine)
    back = configuration()
    with engine.begin() as connection:
        back.attributes["connection"] = connection
        alembic.command.downgrade(back, "0011")
    left = routines(engine)
    engine.dispose()
    # each is called by the adapter
    assert {
        "procrastinate_defer_jobs_v1",
        "procrastinate_fetch_job_v2",
        "procrastinate_finish_job_v1",
        "procrastinate_cancel_job_v1",
        "procrastinate_retry_job_v2",
        "procrastinate_update_heartbeat_v1",
    } <= made
    assert left == set()


def routines(engine: sa.Engine) -> set[str]:
    queries = ("SELECT proname FROM pg_proc", "SELECT typname FROM pg_type")
    with engine.begin() as connection:
        names = [str(name) for query in queries for name in connection.execute(sa.text(query)).scalars()]
    return {name for name in names if name.startswith("procrastinate_")}
