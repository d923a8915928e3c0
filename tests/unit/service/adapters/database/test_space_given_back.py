"""The embedded database becomes small again when what filled it is deleted."""

from datetime import UTC, datetime
from pathlib import Path

import pytest
import sqlalchemy as sa

from service.adapters.database.jobs import DatabaseJobStore, give_space_back, let_shrink, migrate
from service.adapters.database.tables import connect
from service.ports import Job, JobStatus
from service.settings import Settings

NOW = datetime(2026, 1, 2, tzinfo=UTC)
LARGE = "a" * 1_000_000


def _size(settings: Settings) -> int:
    return sum(path.stat().st_size for path in settings.data_dir.glob("tieline.sqlite*"))


def _filled_and_emptied(settings: Settings) -> tuple[int, int]:
    engine = connect(settings)
    store = DatabaseJobStore(engine)
    for number in range(10):
        job = Job(
            id=f"{number:032x}",
            process_id="echo",
            inputs={"stringInput": LARGE},
            status=JobStatus.ACCEPTED,
            created=NOW,
            updated=NOW,
        )
        store.create_and_enqueue(job)
        assert store.inputs_bytes() > len(LARGE)
        store.dismiss(job.id, NOW)
    full = _size(settings)
    assert store.inputs_bytes() > 10 * len(LARGE)
    for number in range(10):
        store.delete(f"{number:032x}")
    assert store.inputs_bytes() == 0
    give_space_back(engine)
    engine.dispose()
    return full, _size(settings)


def test_a_database_that_was_filled_and_emptied_is_small_again(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path)
    migrate(settings)
    full, after = _filled_and_emptied(settings)
    assert full > 10 * len(LARGE)
    assert after < len(LARGE)


@pytest.mark.parametrize("times", [1, 2])
def test_a_database_of_an_earlier_version_learns_it(tmp_path: Path, times: int) -> None:
    settings = Settings(data_dir=tmp_path)
    old = sa.create_engine(settings.sqlalchemy_url)
    with old.begin() as connection:
        connection.exec_driver_sql("CREATE TABLE earlier (a TEXT)")
    old.dispose()
    migrate(settings)
    for _ in range(times):
        let_shrink(settings)
    full, after = _filled_and_emptied(settings)
    assert after < len(LARGE) < full
