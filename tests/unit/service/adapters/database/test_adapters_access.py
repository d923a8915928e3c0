"""Keys, audit log and first answers: the memory and the database adapters keep the same promises."""

from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from service.adapters.database.audit import DatabaseAuditLog
from service.adapters.database.files import DatabaseFileStore
from service.adapters.database.idempotency import DatabaseIdempotencyStore
from service.adapters.database.jobs import DatabaseJobStore, migrate
from service.adapters.database.keys import DatabaseKeyStore
from service.adapters.database.sessions import DatabaseSessionStore
from service.adapters.database.tables import connect
from service.dependencies import AccessStores
from service.ports import (
    Answer,
    AuditEntry,
    AuditFilter,
    FileStore,
    Job,
    JobFilter,
    JobStatus,
    JobStore,
    Key,
    Scope,
    StoredAmount,
    StoredFile,
    StoredKey,
    UnfinishedJobs,
)
from service.settings import Settings
from tests.doubles.memory import MemoryFileStore, MemoryJobStore
from tests.doubles.memory_access import memory_access
from tests.servers.databases import DATABASES, databases_of

NOW = datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC)
DAY = timedelta(days=1)
KEY = Key("k1", "alice", "bridge", frozenset({Scope.READ, Scope.ADMIN}), NOW)
STORED = StoredKey(KEY, "scrypt$…")
ENTRY = AuditEntry(NOW, "k1", "bridge", "10.0.0.7", "POST", "/files", 201, "r1")
ANSWER = Answer(201, [("location", "/jobs/1"), ("link", "a"), ("link", "b")], b"{}\x00\xff")
JOB = Job("j1", "echo", {}, JobStatus.ACCEPTED, NOW)
FILE = StoredFile("f1", "a.e57", 70, "0" * 64, "e57", "scan", NOW)


@pytest.fixture(params=["memory", *DATABASES])
def everything(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[tuple[AccessStores, JobStore, FileStore]]:
    if request.param == "memory":
        yield (
            memory_access(),
            MemoryJobStore(),
            MemoryFileStore(),
        )
        return
    with ExitStack() as stack:
        settings = Settings(data_dir=tmp_path, database_url=databases_of(request, request.param)())
        migrate(settings)
        engine = connect(settings)
        stack.callback(engine.dispose)
        access = AccessStores(
            DatabaseKeyStore(engine),
            DatabaseAuditLog(engine),
            DatabaseIdempotencyStore(engine),
            DatabaseSessionStore(engine),
        )
        yield access, DatabaseJobStore(engine), DatabaseFileStore(engine)


@pytest.fixture
def access(everything: tuple[AccessStores, JobStore, FileStore]) -> AccessStores:
    return everything[0]


@pytest.fixture
def jobs(everything: tuple[AccessStores, JobStore, FileStore]) -> JobStore:
    return everything[1]


@pytest.fixture
def files(everything: tuple[AccessStores, JobStore, FileStore]) -> FileStore:
    return everything[2]


def test_a_key_comes_back_as_it_was_stored(access: AccessStores) -> None:
    assert access.keys.add(STORED)
    assert (access.keys.get("k1"), access.keys.find(10, 0), access.keys.get("k2")) == (STORED, ([KEY], 1), None)


def test_it_is_known_whether_there_was_ever_a_key(access: AccessStores) -> None:
    before = access.keys.known()
    access.keys.add(STORED)
    access.keys.revoke("k1", NOW)
    assert (before, access.keys.known()) == (False, True)


def test_a_name_is_free_again_when_its_key_opens_nothing(access: AccessStores) -> None:
    twin = replace(STORED, key=replace(KEY, id="k2"))
    access.keys.add(STORED)
    taken = access.keys.add(twin)
    access.keys.revoke("k1", NOW)
    assert (taken, access.keys.add(twin)) == (False, True)


def test_a_key_is_revoked_at_its_first_revocation(access: AccessStores) -> None:
    access.keys.add(STORED)
    access.keys.revoke("k1", NOW)
    revoked = access.keys.revoke("k1", NOW + DAY)
    assert revoked is not None
    assert (revoked.revoked, revoked.valid(NOW), access.keys.revoke("k2", NOW)) == (NOW, False, None)


def test_the_last_use_of_a_key_is_kept(access: AccessStores) -> None:
    access.keys.add(STORED)
    access.keys.touch("k1", NOW + DAY)
    found = access.keys.get("k1")
    assert found is not None
    assert found.key.last_used == NOW + DAY


def test_the_audit_log_is_listed_newest_first_and_filtered(access: AccessStores) -> None:
    entries = [ENTRY, replace(ENTRY, key_id="k2", time=NOW + DAY), replace(ENTRY, project="", time=NOW + 2 * DAY)]
    for entry in entries:
        access.audit.write(entry)
    find = access.audit.find
    assert find(AuditFilter()) == (entries[::-1], 3)
    assert find(AuditFilter(limit=1, offset=1)) == ([entries[1]], 3)
    assert find(AuditFilter(key_id="k2")) == ([entries[1]], 1)
    assert find(AuditFilter(project="")) == ([entries[2]], 1)
    assert find(AuditFilter(since=NOW + DAY)) == (entries[:0:-1], 2)


def test_old_entries_of_the_audit_log_are_forgotten(access: AccessStores) -> None:
    access.audit.write(ENTRY)
    access.audit.write(replace(ENTRY, time=NOW + DAY))
    assert (access.audit.forget_before(NOW + DAY), access.audit.find(AuditFilter())[1]) == (1, 1)


def test_a_request_is_claimed_by_the_first_only(access: AccessStores) -> None:
    first = access.answers.claim("bridge", "k", "h1", NOW, 30.0)
    second = access.answers.claim("bridge", "k", "h2", NOW, 30.0)
    assert (first.mine, second.mine, second.seed == first.seed) == (True, False, True)


def test_the_same_key_of_another_project_is_another_request(access: AccessStores) -> None:
    first = access.answers.claim("bridge", "k", "h1", NOW, 30.0)
    second = access.answers.claim("tower", "k", "h2", NOW, 30.0)
    assert (second.mine, second.seed != first.seed) == (True, True)


def test_an_answer_comes_back_as_it_was_kept(access: AccessStores) -> None:
    access.answers.claim("", "k", "h1", NOW, 30.0)
    access.answers.note_fingerprint("", "k", "h1", "f" * 64)
    access.answers.keep_answer("", "k", "h1", ANSWER)
    again = access.answers.claim("", "k", "h2", NOW, 30.0)
    assert (again.mine, again.fingerprint, again.answer) == (False, "f" * 64, ANSWER)


def test_a_request_whose_holder_died_is_taken_over_with_the_same_seed(access: AccessStores) -> None:
    first = access.answers.claim("", "k", "h1", NOW, -1.0)
    access.answers.note_fingerprint("", "k", "h1", "f" * 64)
    second = access.answers.claim("", "k", "h2", NOW, 30.0)
    access.answers.keep_answer("", "k", "h1", ANSWER)  # of the first, which was not dead but slow
    third = access.answers.claim("", "k", "h3", NOW, 30.0)
    assert (second.mine, second.seed, second.fingerprint) == (True, first.seed, "f" * 64)
    assert (third.mine, third.answer) == (False, None)


def test_who_holds_a_request_keeps_it(access: AccessStores) -> None:
    access.answers.claim("", "k", "h1", NOW, -1.0)
    access.answers.hold("", "k", "h1", 30.0)
    assert not access.answers.claim("", "k", "h2", NOW, 30.0).mine


def test_a_request_that_is_let_go_may_be_tried_again_with_the_same_seed(access: AccessStores) -> None:
    first = access.answers.claim("", "k", "h1", NOW, 30.0)
    access.answers.let_go("", "k", "h1")
    second = access.answers.claim("", "k", "h2", NOW, 30.0)
    assert (second.mine, second.seed) == (True, first.seed)


def test_a_forgotten_request_is_a_new_one(access: AccessStores) -> None:
    first = access.answers.claim("", "k", "h1", NOW, 30.0)
    access.answers.forget("", "k", "other")
    access.answers.forget("", "k", "h1")
    second = access.answers.claim("", "k", "h2", NOW, 30.0)
    assert (second.mine, second.seed != first.seed) == (True, True)


def test_an_answer_is_given_again_for_a_day(access: AccessStores) -> None:
    for key in ("early", "late"):
        access.answers.claim("", key, "h1", NOW, 30.0)
        access.answers.keep_answer("", key, "h1", ANSWER)
    assert access.answers.claim("", "early", "h2", NOW + DAY, 30.0).answer == ANSWER
    assert access.answers.claim("", "early", "h2", NOW + DAY + timedelta(seconds=1), 30.0).mine
    assert access.answers.forget_before(NOW + timedelta(seconds=1)) == 1


def test_the_secret_of_sessions_is_made_once(access: AccessStores) -> None:
    made = access.sessions.secret()
    assert (len(made), access.sessions.secret()) == (32, made)


def test_a_session_that_was_ended_is_known_until_it_would_have_run_out(access: AccessStores) -> None:
    for _ in range(2):
        access.sessions.end("s1", NOW)
    known = access.sessions.has_ended("s1"), access.sessions.has_ended("s2")
    assert (known, access.sessions.forget_before(NOW), access.sessions.has_ended("s1")) == ((True, False), 0, True)
    assert (access.sessions.forget_before(NOW + DAY), access.sessions.has_ended("s1")) == (1, False)


def test_a_store_of_one_project_knows_nothing_of_others(jobs: JobStore, files: FileStore) -> None:
    jobs.of("a").create_and_enqueue(replace(JOB, file_ids=("f1",)))
    files.of("a").add(FILE)
    others_jobs, others_files = jobs.of("b"), files.of("b")
    assert (others_jobs.get("j1"), others_jobs.find(JobFilter()), others_files.get("f1")) == (None, ([], 0), None)
    assert (others_jobs.unfinished_using("f1"), others_files.find(10, 0), others_files.amount()) == (
        None,
        ([], 0),
        StoredAmount(0, 0),
    )
    assert (others_jobs.dismiss("j1", NOW), others_files.delete("f1")) == (None, False)
    jobs.dismiss("j1", NOW)
    others_jobs.delete("j1")
    assert (jobs.of("a").get("j1") is not None, files.of("a").get("f1") is not None) == (True, True)


def test_no_way_leads_from_one_project_to_another(jobs: JobStore, files: FileStore) -> None:
    for store in (jobs, files):
        with pytest.raises(PermissionError):
            store.of("a").of("b")


def test_what_is_new_belongs_to_the_project_whose_store_it_is_put_into(jobs: JobStore, files: FileStore) -> None:
    jobs.of("a").create_and_enqueue(replace(JOB, owner="b"))
    files.of("a").add(replace(FILE, owner="b"))
    job, file = jobs.get("j1"), files.get("f1")
    assert job is not None
    assert file is not None
    assert (job.owner, file.owner) == ("a", "a")


def test_who_admits_jobs_sees_those_that_have_not_finished(jobs: JobStore) -> None:
    seen: list[UnfinishedJobs] = []
    for job_id, owner in (("j1", "a"), ("j2", "b"), ("j3", "a"), ("j4", "a")):
        jobs.of(owner).create_and_enqueue(replace(JOB, id=job_id), seen.append)
        if job_id == "j3":
            jobs.dismiss("j1", NOW)
    assert seen == [UnfinishedJobs(0, 0), UnfinishedJobs(0, 1), UnfinishedJobs(1, 2), UnfinishedJobs(1, 2)]


def test_who_admits_files_sees_those_of_the_project(files: FileStore) -> None:
    seen: list[StoredAmount] = []
    for file_id, owner in (("f1", "a"), ("f2", "b"), ("f3", "a")):
        files.of(owner).add(replace(FILE, id=file_id), admit=seen.append)
    assert seen == [StoredAmount(0, 0), StoredAmount(0, 0), StoredAmount(1, 70)]
    assert (files.amount(), files.of("a").amount()) == (StoredAmount(3, 210), StoredAmount(2, 140))


def test_what_was_computed_of_files_counts_for_the_files_of_the_project(files: FileStore) -> None:
    mine, theirs = files.of("a"), files.of("b")
    mine.add(FILE)
    theirs.add(replace(FILE, id="f2"))
    mine.note_computed(FILE.sha256, 30)
    once = mine.amount(), theirs.amount()
    mine.add(replace(FILE, id="f3"))  # has the same beside it
    mine.delete("f1")
    assert (once, mine.amount()) == ((StoredAmount(1, 100), StoredAmount(1, 70)), StoredAmount(1, 100))


def test_a_content_may_be_unused_in_one_project(files: FileStore) -> None:
    files.of("a").add(FILE)
    called: list[str] = []
    told = [files.remove_unused(FILE.sha256, lambda owner=owner: called.append(owner), owner) for owner in ("a", "b")]
    assert (told, called) == ([False, True], ["b"])


def test_what_is_not_admitted_is_not_there(jobs: JobStore, files: FileStore) -> None:
    def refuse(_what: object) -> None:
        raise ConnectionError

    with pytest.raises(ConnectionError):
        jobs.create_and_enqueue(JOB, refuse)
    with pytest.raises(ConnectionError):
        files.add(FILE, admit=refuse)
    assert (jobs.get("j1"), files.get("f1")) == (None, None)
