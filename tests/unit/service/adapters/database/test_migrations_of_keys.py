"""What was stored before there were projects belongs to the default project."""

from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import alembic.command
import alembic.config
import pytest
import sqlalchemy as sa

import service.adapters.database.migrations as migrations_package
from service.adapters.database.files import DatabaseFileStore
from service.adapters.database.jobs import DatabaseJobStore, migrate
from service.adapters.database.tables import connect
from service.ports import JobStatus
from service.settings import Settings

NOW = datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC)


def _change_to(engine: sa.Engine, revision: str, change: str = "upgrade") -> None:
    configuration = alembic.config.Config()
    configuration.set_main_option("script_location", str(Path(migrations_package.__path__[0])))
    with engine.begin() as connection:
        configuration.attributes["connection"] = connection
        getattr(alembic.command, change)(configuration, revision)


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    return Settings(data_dir=tmp_path)


@pytest.fixture
def engine(settings: Settings) -> Iterator[sa.Engine]:
    """Give a database as version 0002 left it, with a job and a file."""
    engine = connect(settings)
    _change_to(engine, "0002")
    with engine.begin() as connection:
        connection.execute(
            sa.text(
                "insert into jobs (id, process_id, inputs, status, created, progress, message, attempts) "
                "values ('j1', 'echo', '{}', 'accepted', :now, 0, '', 0)"
            ),
            {"now": NOW.isoformat(sep=" ")},
        )
        connection.execute(
            sa.text(
                "insert into files (id, name, bytes, sha256, format, kind, created, scans, photos) "
                "values ('f1', 'a.e57', 3, '00', 'e57', 'scan', :now, '[]', '[]')"
            ),
            {"now": NOW.isoformat(sep=" ")},
        )
    yield engine
    engine.dispose()


def test_jobs_and_files_of_the_previous_schema_belong_to_the_default_project(
    engine: sa.Engine, settings: Settings
) -> None:
    migrate(settings)
    job = DatabaseJobStore(engine).of("").get("j1")
    file = DatabaseFileStore(engine).of("").get("f1")
    assert job is not None
    assert file is not None
    assert (job.status, job.owner, job.urgency, file.owner) == (JobStatus.ACCEPTED, "", 3, "")


def test_they_belong_to_no_other_project(engine: sa.Engine, settings: Settings) -> None:
    migrate(settings)
    assert DatabaseJobStore(engine).of("other").get("j1") is None
    assert DatabaseFileStore(engine).of("other").find(10, 0) == ([], 0)


def test_the_way_back_loses_no_job(engine: sa.Engine, settings: Settings) -> None:
    migrate(settings)
    _change_to(engine, "0002", "downgrade")
    with engine.connect() as connection:
        assert connection.execute(sa.text("select id from jobs")).scalars().all() == ["j1"]
