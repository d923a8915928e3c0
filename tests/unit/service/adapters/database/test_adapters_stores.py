"""Jobs and files: the memory and the database adapters keep the same promises."""

import asyncio
import json
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import fields, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa

from service.adapters.database.files import DatabaseFileStore
from service.adapters.database.job_log import DatabaseJobLog
from service.adapters.database.jobs import DatabaseJobStore, migrate
from service.adapters.database.tables import connect, metadata
from service.ports import (
    FileStore,
    Job,
    JobFilter,
    JobLog,
    JobState,
    JobStatus,
    JobStore,
    JsonText,
    LogLine,
    StoredFile,
)
from service.settings import Settings
from tests.doubles.memory import MemoryFileStore, MemoryJobLog, MemoryJobStore
from tests.servers.databases import DATABASES, NewDatabase, databases_of

NOW = datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC)
JOB = Job("j1", "register", {"a": [1, 2]}, JobStatus.ACCEPTED, NOW, file_ids=("f2", "f1"))
FILE = StoredFile("f1", "a.e57", 5_000_000_000, "0" * 64, "e57", "scan", NOW, scans=({"index": 0},))
MakeEngine = Callable[[NewDatabase], sa.Engine]


@pytest.fixture
def make_engine(tmp_path: Path) -> Iterator[MakeEngine]:
    with ExitStack() as stack:

        def make(new_database: NewDatabase) -> sa.Engine:
            settings = Settings(data_dir=tmp_path, database_url=new_database())
            migrate(settings)
            engine = connect(settings)
            stack.callback(engine.dispose)
            return engine

        yield make


@pytest.fixture
def engine(make_engine: MakeEngine, new_database: NewDatabase) -> sa.Engine:
    return make_engine(new_database)


@pytest.fixture(params=["memory", *DATABASES])
def jobs(request: pytest.FixtureRequest, make_engine: MakeEngine) -> JobStore:
    if request.param == "memory":
        return MemoryJobStore()
    return DatabaseJobStore(make_engine(databases_of(request, request.param)))


@pytest.fixture(params=["memory", *DATABASES])
def files(request: pytest.FixtureRequest, make_engine: MakeEngine) -> FileStore:
    if request.param == "memory":
        return MemoryFileStore()
    return DatabaseFileStore(make_engine(databases_of(request, request.param)))


def test_a_job_comes_back_as_it_was_stored(jobs: JobStore) -> None:
    jobs.create_and_enqueue(JOB)
    assert jobs.whole("j1") == JOB


def test_inputs_that_another_process_has_written_are_kept_as_they_are(jobs: JobStore) -> None:
    text = JsonText('{"a":  [1, 2]}')
    jobs.create_and_enqueue(replace(JOB, inputs={}), inputs=text)
    whole = jobs.whole("j1")
    assert whole is not None
    assert whole.inputs == {"a": [1, 2]}
    assert json.loads(jobs.inputs_text("j1") or "") == {"a": [1, 2]}
    assert jobs.inputs_bytes() > 0
    assert jobs.inputs_text("j2") is None
    assert jobs.of("bridge").inputs_text("j1") is None


def state(job: Job | JobState | None) -> dict[str, Any]:
    return {each.name: getattr(job, each.name) for each in fields(JobState)}


@pytest.mark.parametrize("begun", [False, True])
def test_a_look_at_a_job_tells_what_is_known_of_it(jobs: JobStore, begun: bool) -> None:
    jobs.create_and_enqueue(JOB)
    if begun:
        jobs.start("j1", NOW)
        jobs.report("j1", 40, "half", NOW + timedelta(seconds=1.25))
    assert state(asyncio.run(jobs.look("j1"))) == state(jobs.get("j1"))


def test_a_look_tells_nothing_of_jobs_of_others_or_of_none(jobs: JobStore) -> None:
    jobs.of("bridge").create_and_enqueue(JOB)
    assert asyncio.run(jobs.of("bridge").look("j1")) is not None
    assert asyncio.run(jobs.of("tower").look("j1")) is None
    assert asyncio.run(jobs.look("j2")) is None


def test_jobs_are_listed_newest_first_in_pages(jobs: JobStore) -> None:
    for i in range(5):
        jobs.create_and_enqueue(replace(JOB, id=f"j{i}", created=NOW + timedelta(seconds=i)))
    found, number = jobs.find(JobFilter(limit=2, offset=1))
    assert ([job.id for job in found], number) == (["j3", "j2"], 5)


def test_jobs_are_filtered_by_status_and_process(jobs: JobStore) -> None:
    jobs.create_and_enqueue(JOB)
    jobs.create_and_enqueue(replace(JOB, id="j2", process_id="echo"))
    jobs.start("j2", NOW)
    found, number = jobs.find(JobFilter(statuses=(JobStatus.RUNNING,), process_ids=("echo",)))
    assert ([job.id for job in found], number) == (["j2"], 1)


def test_each_start_counts_an_attempt_and_keeps_the_first_time(jobs: JobStore) -> None:
    jobs.create_and_enqueue(JOB)
    jobs.start("j1", NOW)
    job = jobs.start("j1", NOW + timedelta(seconds=9))
    assert job is not None
    assert (job.attempts, job.started, job.status) == (2, NOW, JobStatus.RUNNING)


def test_progress_never_goes_back(jobs: JobStore) -> None:
    jobs.create_and_enqueue(JOB)
    jobs.report("j1", 40, "half", NOW)
    jobs.report("j1", 30, "again", NOW)
    job = jobs.get("j1")
    assert job is not None
    assert (job.progress, job.message) == (40, "again")


@pytest.mark.parametrize("end", ["succeed", "fail", "dismiss"])
def test_a_final_status_never_changes(jobs: JobStore, end: str) -> None:
    jobs.create_and_enqueue(JOB)
    ends = {
        "succeed": lambda: jobs.succeed("j1", NOW),
        "fail": lambda: jobs.fail("j1", {"title": "broken"}, NOW),
        "dismiss": lambda: jobs.dismiss("j1", NOW),
    }
    ends.pop(end)()
    final = jobs.get("j1")
    later = NOW + timedelta(seconds=1)
    answers = (
        jobs.succeed("j1", later),
        jobs.fail("j1", {"title": "other"}, later),
        jobs.report("j1", 99, "no", later),
        jobs.start("j1", later),
        jobs.dismiss("j1", later),
    )
    assert (answers, jobs.get("j1")) == ((False, False, False, None, final), final)


def test_a_failed_job_keeps_its_problem_and_says_why(jobs: JobStore) -> None:
    jobs.create_and_enqueue(JOB)
    jobs.fail("j1", {"title": "broken", "detail": "no lines"}, NOW)
    job = jobs.get("j1")
    assert job is not None
    assert (job.problem, job.message, job.finished) == ({"title": "broken", "detail": "no lines"}, "no lines", NOW)


def test_an_unfinished_job_is_not_forgotten(jobs: JobStore) -> None:
    jobs.create_and_enqueue(JOB)
    jobs.delete("j1")
    assert jobs.whole("j1") == JOB


def test_a_finished_job_is_forgotten(jobs: JobStore) -> None:
    jobs.create_and_enqueue(JOB)
    jobs.dismiss("j1", NOW)
    jobs.delete("j1")
    assert jobs.get("j1") is None


def test_a_file_is_in_use_only_while_its_job_is_unfinished(jobs: JobStore) -> None:
    jobs.create_and_enqueue(JOB)
    before = jobs.unfinished_using("f1")
    jobs.dismiss("j1", NOW)
    assert (before and before.id, jobs.unfinished_using("f1")) == ("j1", None)


def test_a_file_comes_back_as_it_was_stored(files: FileStore) -> None:
    files.add(FILE)
    assert (files.get("f1"), files.find(10, 0)) == (FILE, ([FILE], 1))


def test_a_file_is_deleted_once(files: FileStore) -> None:
    files.add(FILE)
    assert (files.delete("f1"), files.delete("f1"), files.get("f1")) == (True, False, None)


def test_the_migrations_make_the_tables_that_the_code_uses(engine: sa.Engine) -> None:
    found = sa.MetaData()
    found.reflect(engine)
    columns = {
        (table.name, column.name, column.nullable) for table in metadata.tables.values() for column in table.columns
    }
    # the queue that PostgreSQL may be given brings its own
    ours = [table for table in found.tables.values() if not table.name.startswith("procrastinate_")]
    made = {(table.name, column.name, column.nullable) for table in ours for column in table.columns}
    assert made - columns == {("alembic_version", "version_num", False)}


def test_migrating_twice_changes_nothing(tmp_path: Path, new_database: NewDatabase) -> None:
    settings = Settings(data_dir=tmp_path, database_url=new_database())
    migrate(settings)
    migrate(settings)


def test_the_contents_of_all_files_are_listed_once(files: FileStore) -> None:
    for file_id, sha256 in (("f1", "0" * 64), ("f2", "0" * 64), ("f3", "1" * 64)):
        files.add(replace(FILE, id=file_id, sha256=sha256))
    assert files.contents() == {"0" * 64, "1" * 64}


def test_a_file_whose_content_cannot_be_placed_is_not_entered(files: FileStore) -> None:
    def fail() -> None:
        raise ConnectionError

    with pytest.raises(ConnectionError):
        files.add(FILE, fail)
    assert files.get("f1") is None


def test_a_content_is_removed_with_its_last_file_only(files: FileStore) -> None:
    removed: list[str] = []
    files.add(FILE)
    files.add(replace(FILE, id="f2"))
    files.delete("f1")
    assert not files.remove_unused(FILE.sha256, lambda: removed.append("early"))
    files.delete("f2")
    assert files.remove_unused(FILE.sha256, lambda: removed.append("last"))
    assert removed == ["last"]


def test_files_are_forgotten_only_while_their_content_is_away(files: FileStore) -> None:
    files.add(FILE)
    files.add(replace(FILE, id="f2"))
    assert (files.forget_lost(FILE.sha256, lambda: True), files.forget_lost(FILE.sha256, lambda: False)) == (0, 2)
    assert files.find(10, 0) == ([], 0)


@pytest.fixture(params=["memory", *DATABASES])
def job_log(request: pytest.FixtureRequest, make_engine: MakeEngine) -> JobLog:
    if request.param == "memory":
        return MemoryJobLog()
    engine = make_engine(databases_of(request, request.param))
    DatabaseJobStore(engine).create_and_enqueue(JOB)
    return DatabaseJobLog(engine)


def test_the_last_lines_of_a_log_come_back_in_the_order_in_which_they_were_written(job_log: JobLog) -> None:
    job_log.write("j1", [LogLine(NOW, "info", "a"), LogLine(NOW, "warning", "b")])
    job_log.write("j1", [LogLine(NOW, "error", "c")])
    assert job_log.read("j1", 2) == [LogLine(NOW, "warning", "b"), LogLine(NOW, "error", "c")]
    assert job_log.read("j2", 2) == []


def test_the_log_goes_with_its_job_and_what_comes_later_is_lost(engine: sa.Engine) -> None:
    jobs, log = DatabaseJobStore(engine), DatabaseJobLog(engine)
    jobs.create_and_enqueue(JOB)
    log.write("j1", [LogLine(NOW, "info", "a")])
    jobs.dismiss("j1", NOW)
    jobs.delete("j1")
    log.write("j1", [LogLine(NOW, "info", "b")])
    assert log.read("j1", 10) == []


def test_results_count_for_their_project_as_long_as_there_is_the_job(jobs: JobStore) -> None:
    for job_id, owner, size in (("j1", "a", 6_000_000_000), ("j2", "a", 5), ("j3", "b", 70)):
        jobs.of(owner).create_and_enqueue(replace(JOB, id=job_id))
        jobs.note_results(job_id, size)
    jobs.of("b").note_results("j2", 1_000)
    assert [jobs.results_bytes(), jobs.of("a").results_bytes(), jobs.of("c").results_bytes()] == [
        6_000_000_075,
        6_000_000_005,
        0,
    ]
    jobs.fail("j1", {"title": "no"}, NOW)
    jobs.delete("j1")
    assert jobs.of("a").results_bytes() == 5


def test_jobs_whose_results_were_not_counted_are_found_when_they_have_ended(jobs: JobStore) -> None:
    for number in range(5):
        jobs.create_and_enqueue(replace(JOB, id=f"j{number}"))
    for number in range(4):
        jobs.dismiss(f"j{number}", NOW + timedelta(seconds=number))
    jobs.note_results("j1", 0)
    assert sorted(jobs.uncounted(NOW + timedelta(seconds=3), 10)) == ["j0", "j2"]
    assert len(jobs.uncounted(NOW + timedelta(seconds=9), 2)) == 2
