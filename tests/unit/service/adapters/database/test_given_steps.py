"""Steps that Procrastinate gives: offered and withdrawn in our transactions, in a fair order, and never forgotten."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from typing import Any

import pytest
import sqlalchemy as sa

from service.adapters.database.executors import DatabaseExecutors
from service.adapters.database.given import HELD_BACK, TIMES
from service.adapters.database.jobs import DatabaseJobStore, migrate
from service.adapters.database.steps import DatabaseSteps
from service.adapters.database.tables import connect
from service.ports import Job, JobStatus, StepCall, StepPlace, UnfinishedJobs
from service.settings import Settings
from tests.servers.postgres_server import PostgresServer

pytestmark = pytest.mark.service

NOW = datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC)
JOB = Job("j", "register", {}, JobStatus.ACCEPTED, NOW, owner="a")
MOST = 3


class Queue:
    """What is kept, and the library in whose worker's place the test stands."""

    def __init__(self, settings: Settings) -> None:
        self.engine = connect(settings)
        self.jobs, self.steps = DatabaseJobStore(self.engine), DatabaseSteps(self.engine)
        self.executors = DatabaseExecutors(self.engine)
        self.executors.register("w")
        self.worker = int(self.ask("SELECT worker_id FROM procrastinate_register_worker_v1()")[0][0])
        self.number = 0

    def ask(self, query: str, **values: object) -> Sequence[sa.Row[Any]]:
        with self.engine.begin() as connection:
            return connection.execute(sa.text(query), values).all()

    def send(self, job_id: str, *, width: int = 1, weight: float = 0.0, **of_job: Any) -> None:
        """Send a job; unless its width is 0 it is led on at once."""
        self.number += 1
        created = NOW + timedelta(seconds=self.number)
        job = replace(JOB, id=job_id, created=created, **of_job)
        self.jobs.create_and_enqueue(job, total_weight=weight or width)
        if width:
            self.plan(job_id, 0, width, weight or width)

    def plan(self, job_id: str, stage: int, width: int, weight: float) -> None:
        self.steps.plan_stage(
            job_id, stage, [StepCall("nap", {}, f"{job_id}-{stage}-{n}") for n in range(width)], weight
        )

    def waiting(self) -> list[str]:
        """List what waits, as the library gives it."""
        rows = self.ask("SELECT queueing_lock FROM procrastinate_jobs WHERE status = 'todo' ORDER BY priority DESC, id")
        return [str(row[0]) for row in rows]

    def take(self, *queues: str) -> StepPlace | str | None:
        """Take what comes next: a step, which is begun, or a job that is to be led on."""
        query = "SELECT id, args FROM procrastinate_fetch_job_v2(:queues, :worker)"
        row = self.ask(query, queues=list(queues or ("steps",)), worker=self.worker)[0]
        if row.id is None:
            return None
        if "stage" not in row.args:
            self.ask("SELECT procrastinate_finish_job_v1(:id, 'succeeded', true)", id=row.id)
            return str(row.args["job"])
        place = StepPlace(row.args["job"], row.args["stage"], row.args["position"])
        assert self.steps.begin_step(place, "w", NOW) is not None
        return place

    def order(self) -> list[str]:
        """Take and finish all steps that wait; give their jobs."""
        found = []
        while (place := self.take()) is not None:
            if isinstance(place, StepPlace):
                found.append(place.job_id)
                assert self.steps.finish_step(place, "w", {}, NOW)
                self.end(place)
        return found

    def end(self, place: StepPlace) -> None:
        key = f"{place.job_id}/{place.stage}/{place.index}"
        finish = "SELECT procrastinate_finish_job_v1(id, 'succeeded', true)"
        self.ask(f"{finish} FROM procrastinate_jobs WHERE queueing_lock = :key", key=key)

    def die(self) -> float:
        """Let the worker die, and take up what it left; give how many have died of its step."""
        self.executors.remove("w")
        self.executors.register("w2")
        lost = self.steps.tidy(NOW).steps
        self.executors.register("w")
        return max(self.steps.put_back(each, 1.0, NOW) for each in lost)


@pytest.fixture(scope="module")
def template(tmp_path_factory: pytest.TempPathFactory, postgres: PostgresServer) -> Settings:
    place = tmp_path_factory.mktemp("given")
    made = Settings(data_dir=place, database_url=postgres.new_database(), queue="procrastinate", max_running_jobs=MOST)
    migrate(made)
    return made


@pytest.fixture
def queue(template: Settings) -> Iterator[Queue]:
    made = Queue(template)
    yield made
    for table in ("jobs", "procrastinate_jobs", "procrastinate_workers", "executors"):
        made.ask(f"DELETE FROM {table} RETURNING 1")  # noqa: S608
    made.engine.dispose()


def test_a_job_and_what_leads_it_on_are_there_together_or_not_at_all(queue: Queue) -> None:
    def refuse(_unfinished: UnfinishedJobs) -> None:
        raise RuntimeError

    with pytest.raises(RuntimeError):
        queue.jobs.create_and_enqueue(JOB, refuse)
    assert queue.waiting() == []
    queue.jobs.create_and_enqueue(JOB)
    assert queue.waiting() == ["j"]


def test_steps_wait_in_their_order_and_a_stage_that_is_planned_twice_once(queue: Queue) -> None:
    queue.send("j", width=2)
    queue.plan("j", 0, 5, 5.0)
    assert queue.waiting() == ["j", "j/0/0", "j/0/1"]
    assert [queue.take() for _ in range(4)] == ["j", StepPlace("j", 0, 0), StepPlace("j", 0, 1), None]


def test_later_stages_of_an_older_job_come_before_a_younger_one_and_urgent_jobs_before_both(queue: Queue) -> None:
    queue.send("older", weight=2.0)
    queue.send("younger", weight=2.0)
    assert queue.take() == "older"
    step = queue.take()
    assert step == StepPlace("older", 0, 0)
    queue.send("urgent", urgency=0)
    queue.plan("older", 1, 1, 2.0)
    assert queue.order() == ["urgent", "older", "younger"]


def test_projects_are_served_in_turn_whatever_one_of_them_sends(queue: Queue) -> None:
    queue.send("flood", width=40)
    queue.send("more", width=40)
    assert queue.take() == "flood"
    for _ in range(10):
        queue.take()
    for number in range(2):
        queue.send(f"other{number}", width=3, owner="b")
    order = queue.order()
    # one of the flood may have the same virtual time, and be older
    assert order.index("other0") <= 1
    assert [number for number, job in enumerate(order) if job.startswith("other")][-1] <= 14


def test_only_so_many_jobs_of_a_project_are_offered_and_the_next_one_when_one_of_them_ends(queue: Queue) -> None:
    for number in range(MOST + 2):
        queue.send(f"j{number}", width=0)
    assert queue.waiting() == [f"j{number}" for number in range(MOST)]
    queue.send("urgent", width=0, urgency=0)
    assert queue.waiting()[0] == "urgent"
    queue.jobs.dismiss("j1", NOW)
    queue.jobs.dismiss("urgent", NOW)
    assert queue.waiting() == ["j0", "j2", f"j{MOST}"]


def test_of_a_dismissed_job_nothing_waits_and_what_is_computed_is_told_to_end(queue: Queue) -> None:
    queue.send("j", width=3)
    queue.take()
    queue.take()
    queue.jobs.dismiss("j", NOW)
    rows = queue.ask("SELECT queueing_lock, status::text, abort_requested FROM procrastinate_jobs")
    assert [tuple(row) for row in rows] == [("j/0/0", "doing", True)]


def test_a_step_whose_worker_died_stands_back_and_waits_where_it_is_computed_alone(queue: Queue) -> None:
    queue.send("j", width=2)
    assert queue.take() == "j"
    queue.take()
    assert queue.die() == 1.0
    rows = queue.ask("SELECT queue_name, priority FROM procrastinate_jobs WHERE queueing_lock = 'j/0/0'")
    assert [tuple(row) for row in rows] == [("alone", -3 * TIMES - HELD_BACK)]
    assert [queue.take(), queue.take(), queue.take("alone")] == [StepPlace("j", 0, 1), None, StepPlace("j", 0, 0)]


def test_a_step_is_begun_by_one_worker_and_again_by_the_same_when_the_answer_was_lost(queue: Queue) -> None:
    queue.send("j")
    queue.take()
    place = queue.take()
    assert isinstance(place, StepPlace)
    queue.executors.register("other")
    begun = [queue.steps.begin_step(place, worker, NOW) is not None for worker in ("w", "other", "taken for dead")]
    assert begun == [True, False, False]


def test_what_a_worker_fetched_and_did_not_begin_is_given_again_when_its_heart_has_stopped(queue: Queue) -> None:
    queue.send("j", width=0)
    queue.ask("SELECT id FROM procrastinate_fetch_job_v2(ARRAY['steps'], :worker)", worker=queue.worker)
    queue.steps.tidy(NOW)
    before = queue.waiting()
    queue.ask("UPDATE procrastinate_workers SET last_heartbeat = now() - interval '7 s' RETURNING 1")
    queue.steps.tidy(NOW, by_heart=False)
    doubtful = queue.waiting()
    queue.steps.tidy(NOW)
    assert (before, doubtful, queue.waiting()) == ([], [], ["j"])


def test_what_waits_and_is_not_on_the_queue_is_offered_as_after_an_upgrade(queue: Queue) -> None:
    queue.send("planned", width=2, weight=4.0)
    queue.send("fresh", width=0)
    queue.ask("DELETE FROM procrastinate_jobs RETURNING 1")
    queue.ask("UPDATE jobs SET turn = NULL RETURNING 1")
    queue.steps.tidy(NOW)
    assert queue.order() == ["planned", "planned"]
    assert queue.jobs.get("fresh") is not None
    queue.steps.tidy(NOW)
    assert queue.waiting() == []  # it was led on


def test_jobs_of_another_order_of_steps_are_begun_again(queue: Queue) -> None:
    queue.send("j", width=2)
    queue.ask("UPDATE jobs SET planned = 1000 RETURNING 1")
    assert queue.steps.begin_stale_again() == ["j"]
    queue.steps.tidy(NOW)
    assert queue.waiting() == ["j"]
