"""What is to be told to subscribers: kept with the job's status, handed out to one at a time, on each database."""

import threading
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
import sqlalchemy as sa

from service.adapters.database.callbacks import DatabaseCallbacks
from service.adapters.database.executors import DatabaseExecutors
from service.adapters.database.jobs import DatabaseJobStore, migrate
from service.adapters.database.tables import connect
from service.ports import CallbackEvent, ClaimedCallback, Job, JobStatus, Subscription
from service.settings import Settings
from tests.servers.databases import NewDatabase

NOW = datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC)
LATER = NOW + timedelta(seconds=3)
ALL = Subscription({event: f"https://{event.value}.example/hook" for event in CallbackEvent}, "secret", "https://base")


class Stores:
    """Jobs and callbacks on one database, with two workers that live."""

    def __init__(self, engine: sa.Engine) -> None:
        self.jobs = DatabaseJobStore(engine)
        self.callbacks = DatabaseCallbacks(engine)
        self.executors = DatabaseExecutors(engine)
        for worker in ("w1", "w2"):
            self.executors.register(worker)

    def add(self, job_id: str = "j", subscription: Subscription = ALL) -> None:
        job = Job(job_id, "echo", {}, JobStatus.ACCEPTED, NOW, subscriber=subscription.to_json())
        self.jobs.create_and_enqueue(job)

    def claim(self, worker: str = "w1", limit: int = 10, busy: tuple[str, ...] = ()) -> list[ClaimedCallback]:
        return list(self.callbacks.claim(worker, limit, 60.0, busy))

    def events(self, worker: str = "w1") -> list[str]:
        return [claimed.event.value for claimed in self.claim(worker)]


@pytest.fixture
def stores(tmp_path: Path, new_database: NewDatabase) -> Iterator[Stores]:
    settings = Settings(data_dir=tmp_path, database_url=new_database())
    migrate(settings)
    engine = connect(settings)
    yield Stores(engine)
    engine.dispose()


def test_nothing_is_told_before_a_job_runs(stores: Stores) -> None:
    stores.add()
    assert stores.claim() == []


@pytest.mark.parametrize(("end", "event"), [("succeed", "success"), ("fail", "failed"), ("dismiss", "failed")])
def test_the_end_of_a_job_is_told_once_and_its_progress_no_more(stores: Stores, end: str, event: str) -> None:
    stores.add()
    stores.jobs.start("j", NOW)
    arguments = ({"title": "x"},) if end == "fail" else ()
    getattr(stores.jobs, end)("j", *arguments, NOW)
    (claimed,) = stores.claim()
    assert (claimed.event.value, claimed.uri, claimed.attempt) == (event, f"https://{event}.example/hook", 1)
    stores.callbacks.settle(claimed)
    stores.jobs.succeed("j", LATER)
    assert stores.claim() == []


def test_only_what_the_subscriber_asks_for_is_told(stores: Stores) -> None:
    stores.add(subscription=Subscription({CallbackEvent.FAILED: "https://f.example/"}))
    stores.jobs.start("j", NOW)
    stores.jobs.succeed("j", NOW)
    assert stores.claim() == []


def test_the_subscription_of_a_job_is_kept(stores: Stores) -> None:
    stores.add()
    job = stores.jobs.get("j")
    assert job is not None
    assert job.subscriber is not None
    assert Subscription.from_json(job.subscriber) == ALL


def test_what_one_has_claimed_nobody_else_gets(stores: Stores) -> None:
    stores.add()
    stores.jobs.succeed("j", NOW)
    assert len(stores.claim("w1")) == 1
    assert stores.claim("w2") == stores.claim("w1") == []


def test_each_is_claimed_once_though_many_claim_at_the_same_time(stores: Stores) -> None:
    for number in range(30):
        stores.add(f"j{number}")
        stores.jobs.succeed(f"j{number}", NOW)
    found: list[str] = []

    def claim(worker: str) -> None:
        while claimed := stores.claim(worker, limit=2):
            found.extend(each.job_id for each in claimed)

    threads = [threading.Thread(target=claim, args=(worker,)) for worker in ("w1", "w2", "w1", "w2")]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(found) == sorted(f"j{number}" for number in range(30))


def test_what_a_worker_had_that_is_gone_is_claimed_at_once(stores: Stores) -> None:
    stores.add()
    stores.jobs.succeed("j", NOW)
    stores.claim("w1")
    stores.executors.remove("w1")
    (claimed,) = stores.claim("w2")
    assert claimed.attempt == 2


def test_a_claim_that_others_have_taken_over_ends_nothing(stores: Stores) -> None:
    stores.add()
    stores.jobs.succeed("j", NOW)
    (late,) = stores.claim("w1")
    stores.executors.remove("w1")
    (claimed,) = stores.claim("w2")
    stores.callbacks.settle(late)
    stores.callbacks.retry(claimed, 0.0)
    assert stores.events() == ["success"]


def test_what_is_put_off_is_due_later(stores: Stores) -> None:
    stores.add()
    stores.jobs.succeed("j", NOW)
    (claimed,) = stores.claim()
    stores.callbacks.retry(claimed, 100.0)
    assert stores.claim() == []


def test_what_is_put_off_counts_its_attempts(stores: Stores) -> None:
    stores.add()
    stores.jobs.succeed("j", NOW)
    for attempt in (1, 2, 3):
        (claimed,) = stores.claim()
        assert claimed.attempt == attempt
        stores.callbacks.retry(claimed, 0.0)


def test_progress_goes_on_with_all_attempts_and_a_new_number(stores: Stores) -> None:
    stores.add()
    stores.jobs.start("j", NOW)
    (first,) = stores.claim()
    stores.callbacks.retry(first, 0.0)
    (second,) = stores.claim()
    stores.callbacks.go_on(second, 0.0, NOW)
    (third,) = stores.claim()
    assert [(each.attempt, each.delivered, each.told) for each in (first, second, third)] == [
        *((1, 0, None), (2, 0, None)),
        (1, 1, NOW),
    ]


def test_progress_does_not_go_on_after_the_end_of_the_job(stores: Stores) -> None:
    stores.add(subscription=Subscription({CallbackEvent.IN_PROGRESS: "https://p.example/"}))
    stores.jobs.start("j", NOW)
    (claimed,) = stores.claim()
    stores.jobs.succeed("j", NOW)
    stores.callbacks.go_on(claimed, 0.0, NOW)
    assert stores.claim() == []


def test_hosts_that_are_busy_are_left_out(stores: Stores) -> None:
    stores.add("j1")
    stores.add("j2", Subscription({CallbackEvent.SUCCESS: "https://other.example/"}))
    for job in ("j1", "j2"):
        stores.jobs.succeed(job, NOW)
    assert [each.job_id for each in stores.claim(busy=("success.example",))] == ["j2"]


def test_a_removed_job_has_nothing_to_tell(stores: Stores) -> None:
    stores.add()
    stores.jobs.succeed("j", NOW)
    stores.jobs.delete("j")
    assert stores.claim() == []
