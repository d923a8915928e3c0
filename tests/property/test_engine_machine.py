"""Whatever happens to workers, at whatever moment, jobs end right: a model beside the queue, on each database.

Steps are claimed or given, finished, handed back; workers die, are taken for dead and come back, the answer to what
they did is lost; jobs are dismissed. Never has a step two owners, is what was finished done again or changed, begins a
stage early, is a death counted twice, or does a job stay without an end.
"""

import asyncio
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, cast
from uuid import uuid4

import psycopg
import pytest
import sqlalchemy as sa
from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    invariant,
    rule,
    run_state_machine_as_test,
)

from service.adapters.database.executors import DatabaseExecutors
from service.adapters.database.files import DatabaseFileStore
from service.adapters.database.jobs import DatabaseJobStore, migrate
from service.adapters.database.steps import DatabaseSteps
from service.adapters.database.tables import connect, job_steps
from service.adapters.database.turns import DatabaseTurns
from service.engine.leading import Leader
from service.engine.tools import Tools
from service.ports import FreshJob, Job, JobStatus, Json, LogLine, StepCall, StepPlace
from service.settings import Settings
from tests.servers.postgres_server import PostgresServer

NOW = datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC)
MOST_DEATHS = 3
SLOTS = st.sampled_from(range(3))
ACTS = (
    *(*6 * ("take",), *4 * ("finish",), *3 * ("send",), *2 * ("die",), *3 * ("reap",)),
    *("report", "hand_back", "dismiss", "sweep", *4 * ("take",), *2 * ("finish",)),
)
"""The likelier ones more often."""


class ListedPlan:
    """Stages of as many steps as the inputs say."""

    def next_stage(self, job: Json, outputs: Sequence[Sequence[Json]]) -> Sequence[StepCall] | None:
        widths = job["inputs"]["widths"]
        if len(outputs) == len(widths):
            return None
        return [StepCall("nap", {}, f"{len(outputs)}/{n}") for n in range(widths[len(outputs)])]

    def total_weight(self, job: Json) -> float:
        return float(sum(job["inputs"]["widths"]))


class NoLog:
    def write(self, job_id: str, lines: Sequence[LogLine]) -> None:
        """Nobody reads it here."""


@dataclass
class Claim:
    """What a worker believes to have."""

    place: StepPlace
    worker: str
    library_id: int | None = None


@dataclass
class Known:
    """What is true of a job."""

    widths: Sequence[int]
    over: JobStatus | None = None
    done: dict[tuple[int, int], str] = field(default_factory=dict)
    owners: dict[tuple[int, int], str] = field(default_factory=dict)
    deaths: dict[tuple[int, int], float] = field(default_factory=dict)


class Queue:
    """The queue as it is, of which workers ask for their steps."""

    def __init__(self, made: Settings) -> None:
        self.engine = connect(made)
        self.jobs, self.steps = DatabaseJobStore(self.engine), DatabaseSteps(self.engine)
        self.turns = DatabaseTurns(self.engine, made.max_running_jobs)
        self.executors = DatabaseExecutors(self.engine, several=True)
        tools = Tools(
            settings=made,
            jobs=self.jobs,
            steps=self.steps,
            source=cast("Any", None),
            log=cast("Any", NoLog()),
            files=DatabaseFileStore(self.engine),
            executors=self.executors,
            runner=cast("Any", None),
            plans={"listed": ListedPlan()},
            count_results=lambda _job_id: None,
        )
        self._leader = Leader(tools)

    def enter(self, worker: str) -> None:
        self.executors.register(worker)

    def leave(self, worker: str) -> None:
        """Let a worker be taken for dead."""
        self.executors.remove(worker)

    def lead(self, job_id: str) -> None:
        asyncio.run(self._leader.lead(job_id))

    def take(self, worker: str) -> Claim | None:
        while isinstance(turn := self.turns.take_turn(worker, datetime.now(UTC), alone=True), FreshJob):
            self.lead(turn.id)
        return None if turn is None else Claim(turn.place, worker)

    def end(self, claim: Claim) -> None:
        """Note that a worker has ended what it had."""

    def sweep(self) -> None:
        for job_id in self.steps.tidy(NOW).jobs:
            self.lead(job_id)

    def close(self) -> None:
        self.engine.dispose()


class GivingQueue(Queue):
    """The queue of Procrastinate, in whose worker's place the test stands."""

    def __init__(self, made: Settings) -> None:
        super().__init__(made)
        self._workers: dict[str, int] = {}

    def _ask(self, query: str, **values: object) -> sa.Row[Any]:
        with self.engine.begin() as connection:
            return connection.execute(sa.text(query), values).one()

    def enter(self, worker: str) -> None:
        super().enter(worker)
        self._workers[worker] = self._ask("SELECT * FROM procrastinate_register_worker_v1()")[0]

    def leave(self, worker: str) -> None:
        super().leave(worker)
        with self.engine.begin() as connection:
            gone = sa.text("UPDATE procrastinate_workers SET last_heartbeat = now() - interval '1 h' WHERE id = :id")
            connection.execute(gone, {"id": self._workers[worker]})

    def take(self, worker: str) -> Claim | None:
        query = "SELECT id, args FROM procrastinate_fetch_job_v2(ARRAY['steps', 'alone'], :worker)"
        while (row := self._ask(query, worker=self._workers[worker])).id is not None:
            job_id = row.args["job"]
            if "stage" in row.args:
                place = StepPlace(job_id, row.args["stage"], row.args["position"])
                if self.steps.begin_step(place, worker, datetime.now(UTC)) is not None:
                    return Claim(place, worker, row.id)
            self.lead(job_id)
            self.end(Claim(StepPlace(job_id, 0, 0), worker, row.id))
        return None

    def end(self, claim: Claim) -> None:
        with self.engine.begin() as connection:  # it may have been withdrawn
            row = connection.execute(
                sa.text("SELECT id FROM procrastinate_jobs WHERE id = :id AND status = 'doing'"),
                {"id": claim.library_id},
            )
            if row.first() is not None:
                finish = sa.text("SELECT procrastinate_finish_job_v1(:id, 'succeeded', true)")
                connection.execute(finish, {"id": claim.library_id})

    def hand_back(self, claim: Claim) -> None:
        with self.engine.begin() as connection:
            query = sa.text(
                "SELECT procrastinate_retry_job_v2(id, NULL, NULL, NULL, NULL) FROM procrastinate_jobs "
                "WHERE id = :id AND status = 'doing'"
            )
            connection.execute(query, {"id": claim.library_id})

    def sweep(self) -> None:
        self.steps._next_sweep = 0.0
        super().sweep()


class EngineMachine(RuleBasedStateMachine):
    """All that may happen, in any order."""

    def __init__(self, queue: Queue) -> None:
        super().__init__()
        self.queue = queue
        self.known: dict[str, Known] = {}
        self.claims: list[Claim] = []
        self.workers: list[str] = []
        self.dead: set[str] = set()
        self.number = 0

    @initialize()
    def begin(self) -> None:
        for slot in range(3):
            self.workers.append("")
            self._start(slot)

    def _start(self, slot: int) -> None:
        self.number += 1
        self.workers[slot] = f"w{slot}-{self.number}"
        self.queue.enter(self.workers[slot])

    @rule(data=st.data(), act=st.sampled_from(ACTS))
    def act(self, data: st.DataObject, act: str) -> None:
        """Let something happen: one rule of many acts, none of which hypothesis leaves out for a whole run."""
        getattr(self, act)(data)

    # what clients do

    def send(self, data: st.DataObject) -> None:
        widths = data.draw(st.lists(st.sampled_from((2, 3, 1, 0)), min_size=1, max_size=3))
        owner, urgency = data.draw(st.sampled_from("ab")), data.draw(st.sampled_from((0, 3)))
        self.number += 1
        job_id = f"j{self.number}"
        job = Job(job_id, "listed", {"widths": widths}, JobStatus.ACCEPTED, NOW, owner=owner, urgency=urgency)
        self.queue.jobs.create_and_enqueue(job, total_weight=float(sum(widths)))
        self.known[job_id] = Known(widths)

    def dismiss(self, data: st.DataObject) -> None:
        unfinished = [job_id for job_id, job in self.known.items() if job.over is None]
        if not unfinished:
            return
        job_id = data.draw(st.sampled_from(unfinished))
        job = self.queue.jobs.dismiss(job_id, NOW)
        assert job is not None
        self.known[job_id].over = job.status

    # what workers do

    def take(self, data: st.DataObject) -> None:
        worker = self.workers[data.draw(SLOTS)]
        claim = self.queue.take(worker)
        if claim is not None:
            job, at = self.known[claim.place.job_id], (claim.place.stage, claim.place.index)
            assert job.over is None
            assert at not in job.owners
            assert at not in job.done
            job.owners[at] = worker
            self.claims.append(claim)

    def finish(self, data: st.DataObject) -> None:
        """End a step, perhaps as one that was taken for dead, or twice, or without leading the job on."""
        if not self.claims:
            return
        claim = self.claims.pop(data.draw(st.integers(0, len(self.claims) - 1)))
        answered, led = data.draw(st.booleans()), data.draw(st.integers(0, 3)) > 0
        job, at = self.known[claim.place.job_id], (claim.place.stage, claim.place.index)
        output = {"by": uuid4().hex}
        mine = job.over is None and job.owners.get(at) == claim.worker
        assert self.queue.steps.finish_step(claim.place, claim.worker, output, NOW) == mine
        if mine:
            job.done[at] = output["by"]
            del job.owners[at]
        if not answered:
            assert not self.queue.steps.finish_step(claim.place, claim.worker, {"by": "again"}, NOW)
        if claim.worker in self.dead:
            return  # it has ended when it was told so
        if led:
            self.queue.lead(claim.place.job_id)
            self.queue.end(claim)
        else:
            self._die(self.workers.index(claim.worker))

    def report(self, data: st.DataObject) -> None:
        if not self.claims:
            return
        claim = data.draw(st.sampled_from(self.claims))
        job, at = self.known[claim.place.job_id], (claim.place.stage, claim.place.index)
        mine = job.over is None and job.owners.get(at) == claim.worker
        assert self.queue.steps.report_step(claim.place, claim.worker, 0.5, "half", NOW) == mine

    def hand_back(self, data: st.DataObject) -> None:
        self._hand_back(data.draw(SLOTS))

    def _hand_back(self, slot: int) -> None:
        worker = self.workers[slot]
        self.queue.steps.hand_back(worker)
        for claim in [each for each in self.claims if each.worker == worker]:
            self.claims.remove(claim)
            self.known[claim.place.job_id].owners.pop((claim.place.stage, claim.place.index), None)
            if isinstance(self.queue, GivingQueue):
                self.queue.hand_back(claim)

    def die(self, data: st.DataObject) -> None:
        self._die(data.draw(SLOTS))

    def _die(self, slot: int) -> None:
        """Let a worker be taken for dead, and start another; what it has stays in its hands, and it may come back."""
        self.queue.leave(self.workers[slot])
        self.dead.add(self.workers[slot])
        self._start(slot)

    def reap(self, _data: object = None) -> None:
        left = self.queue.steps.tidy(NOW)
        for lost in left.steps:
            deaths = self.queue.steps.put_back(lost, 1.0, NOW)
            job, at = self.known[lost.place.job_id], (lost.place.stage, lost.place.index)
            assert job.owners.pop(at) == lost.executor_id
            job.deaths[at] = job.deaths.get(at, 0.0) + 1.0
            assert deaths == job.deaths[at]
            assert self.queue.steps.put_back(lost, 1.0, NOW) == 0.0
            if deaths >= MOST_DEATHS:
                assert self.queue.jobs.fail(lost.place.job_id, {"title": "poison"}, NOW)
                job.over = JobStatus.FAILED
        for job_id in left.jobs:
            self.queue.lead(job_id)

    def sweep(self, _data: object = None) -> None:
        self.queue.sweep()

    # what must hold

    @invariant()
    def what_is_kept_is_what_is_true(self) -> None:
        with self.queue.engine.begin() as connection:
            rows = connection.execute(sa.select(job_steps)).all()
        found: dict[str, dict[tuple[int, int], sa.Row[Any]]] = {job_id: {} for job_id in self.known}
        for row in rows:
            found[row.job_id][row.stage, row.position] = row
        for job_id, job in self.known.items():
            steps = found[job_id]
            assert {at: row.output["by"] for at, row in steps.items() if row.state == "done"} == job.done
            if job.over is None:
                assert {at: row.executor for at, row in steps.items() if row.state == "running"} == job.owners
                assert {at: row.deaths for at, row in steps.items() if row.deaths} == job.deaths
            for stage, _ in steps:
                before = {(k, n) for k in range(stage) for n in range(job.widths[k])}
                assert before <= job.done.keys()

    def teardown(self) -> None:
        """Whatever has happened, all jobs come to an end."""
        try:
            self._die(0)
            self.reap()
            for slot in range(3):
                self._hand_back(slot)
            self.queue.sweep()
            worker = self.workers[0]
            while (claim := self.queue.take(worker)) is not None:
                assert self.queue.steps.finish_step(claim.place, worker, {"by": "end"}, NOW)
                self.queue.lead(claim.place.job_id)
                self.queue.end(claim)
            for job_id, job in self.known.items():
                kept = self.queue.jobs.get(job_id)
                assert kept is not None
                assert kept.status is (job.over or JobStatus.SUCCESSFUL)
        finally:
            self.queue.close()


MANY = settings(
    max_examples=15,
    stateful_step_count=60,
    deadline=None,
    derandomize=True,
    phases=(Phase.generate,),
    suppress_health_check=list(HealthCheck),
)


def test_jobs_end_right_on_an_embedded_database(tmp_path: Path) -> None:
    template = tmp_path / "template"
    migrate(Settings(data_dir=template))
    with TemporaryDirectory(dir=tmp_path) as folder:

        def made() -> EngineMachine:
            place = Path(folder) / uuid4().hex
            shutil.copytree(template, place)
            return EngineMachine(Queue(Settings(data_dir=place)))

        run_state_machine_as_test(made, settings=MANY)


@pytest.mark.service
@pytest.mark.parametrize("queue", ["own", "procrastinate"])
def test_jobs_end_right_on_a_server(tmp_path: Path, postgres: PostgresServer, queue: str) -> None:
    of_queue: dict[str, Any] = {"data_dir": tmp_path, "queue": queue}
    template = postgres.new_database()
    migrate(Settings(database_url=template, **of_queue))

    def made() -> EngineMachine:
        name = f"machine_{uuid4().hex[:8]}"
        with psycopg.connect(postgres.url("postgres"), autocommit=True) as connection:
            connection.execute(f"CREATE DATABASE {name} TEMPLATE {template.rpartition('/')[2]}")
        known = Settings(database_url=postgres.url(name), **of_queue)
        return EngineMachine(GivingQueue(known) if queue == "procrastinate" else Queue(known))

    run_state_machine_as_test(made, settings=MANY)
