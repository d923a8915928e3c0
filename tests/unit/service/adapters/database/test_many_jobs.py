"""Ten thousand jobs: what clients and Prometheus ask again and again is found by indexes."""

from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta

import pytest
import sqlalchemy as sa

from service.adapters.database.jobs import DatabaseJobStore, migrate
from service.adapters.database.tables import connect, jobs
from service.ports import JobFilter, JobStatus
from service.settings import Settings

MANY = 10_000
BEGIN = datetime(2026, 1, 1, tzinfo=UTC)
STATUSES = [*[JobStatus.SUCCESSFUL] * 17, JobStatus.FAILED, JobStatus.DISMISSED, JobStatus.ACCEPTED]
Asked = Callable[[DatabaseJobStore], object]


@pytest.fixture(scope="module")
def engine(tmp_path_factory: pytest.TempPathFactory) -> Iterator[sa.Engine]:
    settings = Settings(data_dir=tmp_path_factory.mktemp("many"))
    migrate(settings)
    made = connect(settings)
    rows = [
        {
            "id": f"{number:032x}",
            "process_id": "register",
            "inputs": {},
            "status": STATUSES[number % len(STATUSES)].value,
            "created": BEGIN + timedelta(seconds=number),
            "progress": 0,
            "message": "",
            "attempts": 0,
            "owner": "ab"[number % 2],
        }
        for number in range(MANY)
    ]
    with made.begin() as connection:
        connection.execute(sa.insert(jobs), rows)
    yield made
    made.dispose()


QUESTIONS: dict[str, Asked] = {
    "one job": lambda store: store.get(f"{7:032x}"),
    "a page": lambda store: store.find(JobFilter(limit=100)),
    "a late page": lambda store: store.find(JobFilter(limit=100, offset=MANY - 100)),
    "a page of one project": lambda store: store.of("a").find(JobFilter(limit=100)),
    "results of one project": lambda store: store.of("a").results_bytes(),
    "results not counted": lambda store: store.uncounted(BEGIN, 10),
    "waiting jobs": lambda store: store.find(JobFilter(statuses=(JobStatus.ACCEPTED,), limit=1)),
}


@pytest.mark.parametrize("question", QUESTIONS)
def test_no_question_reads_the_whole_table(engine: sa.Engine, question: str) -> None:
    asked: list[tuple[str, object]] = []

    def note(_c: object, _cursor: object, statement: str, parameters: object, *_: object) -> None:
        if statement.startswith("SELECT"):
            asked.append((statement, parameters))

    sa.event.listen(engine, "before_cursor_execute", note)
    try:
        QUESTIONS[question](DatabaseJobStore(engine))
    finally:
        sa.event.remove(engine, "before_cursor_execute", note)
    with engine.begin() as connection:
        plans = [
            row[3]
            for statement, parameters in asked
            for row in connection.exec_driver_sql(f"EXPLAIN QUERY PLAN {statement}", parameters)
        ]
    assert plans
    assert [plan for plan in plans if plan.startswith("SCAN") and "INDEX" not in plan] == []
