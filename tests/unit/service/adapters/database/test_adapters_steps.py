"""The queue of steps: handed out in order to one worker each, recorded, taken back from the dead, on each database."""

import math
import time
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
import sqlalchemy as sa

from service.adapters.database import changes
from service.adapters.database.executors import DatabaseExecutors
from service.adapters.database.jobs import DatabaseJobStore, migrate
from service.adapters.database.steps import DatabaseSteps
from service.adapters.database.tables import connect, job_steps
from service.adapters.database.turns import BEGINNING, DatabaseTurns
from service.ports import ClaimedStep, FreshJob, Job, JobStatus, LostStep, StepCall, StepPlace
from service.settings import Settings
from service.use_cases.jobs.turns import HELD_BACK_S
from tests.servers.databases import NewDatabase

NOW = datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC)
JOB = Job("j1", "register", {}, JobStatus.ACCEPTED, NOW, owner="a", request_id="r1")
MOST = 4


class Stores:
    def __init__(self, engine: sa.Engine) -> None:
        self.engine = engine
        self.jobs = DatabaseJobStore(engine)
        self.steps = DatabaseSteps(engine)
        self.turns = DatabaseTurns(engine, MOST)
        self.executors = DatabaseExecutors(engine)
        for worker in ("w1", "w2"):
            self.executors.register(worker)

    def add(self, job_id: str, seconds: float = 0.0, stage: int | None = 0, width: int = 1, **of_job: object) -> None:
        """Make a job; unless `stage` is None its steps wait."""
        created = NOW + timedelta(seconds=seconds)
        self.jobs.create_and_enqueue(replace(JOB, id=job_id, created=created, **of_job))  # type: ignore[arg-type]
        if stage is not None:
            calls = [StepCall("nap", {"n": n}, f"{job_id} nap {n}") for n in range(width)]
            self.steps.plan_stage(job_id, stage, calls, 4.0)

    def take(self, worker: str = "w1", *, alone: bool = True) -> ClaimedStep | FreshJob | None:
        return self.turns.take_turn(worker, NOW, alone=alone)

    def claim(self, worker: str = "w1", *, alone: bool = True) -> ClaimedStep:
        turn = self.take(worker, alone=alone)
        assert isinstance(turn, ClaimedStep)
        return turn

    def finish(self, step: ClaimedStep, worker: str = "w1") -> bool:
        return self.steps.finish_step(step.place, worker, {"of": step.label}, NOW)

    def job(self, job_id: str) -> Job:
        job = self.jobs.get(job_id)
        assert job is not None
        return job

    def order(self) -> list[str]:
        """Claim and finish all that waits; give the jobs in their order."""
        found = []
        while isinstance(step := self.take(), ClaimedStep):
            found.append(step.place.job_id)
            self.finish(step)
        return found


@pytest.fixture
def stores(tmp_path: Path, new_database: NewDatabase) -> Iterator[Stores]:
    settings = Settings(data_dir=tmp_path, database_url=new_database())
    migrate(settings)
    engine = connect(settings)
    yield Stores(engine)
    engine.dispose()


def test_an_embedded_database_that_has_not_changed_is_not_asked_whether_anything_waits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(changes, "ANYWAY_S", math.inf)
    settings = Settings(data_dir=tmp_path)
    migrate(settings)
    engine, other = connect(settings), connect(settings)
    turns, asked = DatabaseTurns(engine, MOST), []
    sa.event.listen(engine, "before_cursor_execute", lambda *told: asked.append(told[2]))
    assert not turns.look()
    time.sleep(2.0 * changes.SETTLED_S)
    assert not turns.look()
    so_far = len(asked)
    assert not any(turns.look() for _ in range(5))
    assert len(asked) == so_far
    DatabaseJobStore(other).create_and_enqueue(JOB)
    assert all(turns.look() for _ in range(2))
    for each in (engine, other):
        each.dispose()


def test_each_step_is_handed_out_once(stores: Stores) -> None:
    stores.add("j1", width=2)
    steps = [stores.claim("w1"), stores.claim("w2")]
    assert [(step.arguments["n"], step.request_id) for step in steps] == [(0, "r1"), (1, "r1")]
    assert (stores.take(), stores.turns.look()) == (None, False)


def test_a_job_runs_from_its_first_step_on_and_waits_before(stores: Stores) -> None:
    stores.add("j1")
    before = stores.job("j1")
    stores.claim()
    after = stores.job("j1")
    assert (before.status, before.attempts) == (JobStatus.ACCEPTED, 0)
    assert (after.status, after.attempts, after.started, after.message) == (JobStatus.RUNNING, 1, NOW, "j1 nap 0")


def test_a_job_of_which_no_step_runs_for_some_seconds_waits_again(stores: Stores) -> None:
    stores.add("j1", width=2)
    stores.add("j2", 1.0, width=2)
    stores.finish(stores.claim())
    stores.claim("w2")
    moments = [NOW + timedelta(seconds=seconds) for seconds in (1.0, 3.0)]
    seen = []
    for moment in moments:
        stores.steps.tidy(moment)
        seen.append(stores.job("j1").status)
    # its second step runs
    assert seen == [JobStatus.RUNNING] * 2
    stores.steps.hand_back("w2")
    for moment in moments:
        stores.steps.tidy(moment)
        seen.append(stores.job("j1").status)
    assert seen[2:] == [JobStatus.RUNNING, JobStatus.ACCEPTED]
    assert stores.job("j1").message == "waiting for a worker"


def test_a_job_waits_again_when_the_place_of_its_step_is_given_to_another(stores: Stores) -> None:
    stores.add("j1", 1.0, width=2)
    first = stores.claim()
    stores.add("older")
    stores.finish(first)
    between = stores.job("j1").status
    stores.claim()
    assert (between, stores.job("j1").status, stores.job("older").status) == (
        *(JobStatus.RUNNING, JobStatus.ACCEPTED),
        JobStatus.RUNNING,
    )


def test_an_interrupted_step_lets_the_others_by_for_a_while(stores: Stores) -> None:
    for number in range(3):
        stores.add(f"j{number}", number)
    stores.claim("w1")
    stores.executors.remove("w1")
    stores.steps.put_back(stores.steps.tidy(NOW).steps[0], 0.25, NOW)
    first = stores.claim("w2")
    with stores.engine.begin() as connection:
        connection.execute(sa.update(job_steps).values(waiting_since=job_steps.c.waiting_since - HELD_BACK_S))
    second = stores.claim("w2")
    assert [first.place.job_id, second.place.job_id] == ["j1", "j0"]


def test_later_stages_of_older_jobs_come_before_earlier_ones_of_younger_jobs(stores: Stores) -> None:
    stores.add("younger", 1.0)
    stores.add("older", stage=1)
    stores.add("oldest", -1.0)
    stores.add("fresh", 2.0, stage=None)
    found = [stores.claim().place.job_id for _ in range(3)]
    assert (found, stores.take()) == (["older", "oldest", "younger"], FreshJob("fresh"))


def test_a_fresh_job_comes_in_where_it_is_more_urgent_or_older(stores: Stores) -> None:
    stores.add("waits")
    stores.add("fresh", -1.0, stage=None)
    assert stores.take() == FreshJob("fresh")
    stores.add("urgent", 5.0, stage=None, urgency=0)
    assert stores.take() == FreshJob("urgent")


def test_only_so_many_jobs_of_a_project_are_begun_and_urgent_ones_besides(stores: Stores) -> None:
    for number in range(MOST):
        stores.add(f"j{number}")
        stores.claim()
    stores.add("next", stage=None)
    assert stores.take() is None
    stores.add("urgent", stage=None, urgency=0)
    assert stores.take() == FreshJob("urgent")


def test_a_job_that_is_being_begun_is_told_to_nobody_else_for_a_while(stores: Stores) -> None:
    for number in range(MOST + 1):
        stores.add(f"j{number}", number - 60.0, stage=None)
    begun = [stores.take(worker) for worker in ("w1", "w2", "w1", "w2", "w1")]
    assert begun == [*(FreshJob(f"j{number}") for number in range(MOST)), None]
    later = NOW + 1.1 * BEGINNING  # who was told so is gone
    assert stores.turns.take_turn("w2", later, alone=True) == FreshJob("j0")


def test_projects_take_turns_whatever_one_of_them_sends(stores: Stores) -> None:
    for number in range(6):
        stores.add(f"a{number}", number)
    stores.finish(stores.claim())
    for number in range(2):
        stores.add(f"b{number}", 100.0 + number, owner="b")
    assert stores.order() == ["b0", "a1", "b1", "a2", "a3", "a4", "a5"]


def test_a_project_with_running_steps_lets_others_first(stores: Stores) -> None:
    stores.add("a0", width=3)
    stores.claim("w1")
    stores.claim("w2")
    stores.add("b0", 1.0, owner="b", width=2)
    owners = [stores.claim(worker).place.job_id for worker in ("w1", "w2")]
    assert owners == ["b0", "b0"]


def test_outputs_come_in_order_when_all_steps_are_done(stores: Stores) -> None:
    stores.add("j1", width=2)
    first, second = stores.claim(), stores.claim()
    stores.finish(second)
    early = stores.steps.outputs("j1")
    stores.finish(first)
    stores.steps.plan_stage("j1", 2, [StepCall("nap", {}, "third")], 4.0)
    stores.finish(stores.claim())
    assert early is None
    assert stores.steps.outputs("j1") == [[{"of": "j1 nap 0"}, {"of": "j1 nap 1"}], [], [{"of": "third"}]]


def test_a_stage_is_planned_once(stores: Stores) -> None:
    stores.add("j1")
    stores.steps.plan_stage("j1", 0, [StepCall("nap", {}, "again"), StepCall("nap", {}, "more")], 4.0)
    assert stores.order() == ["j1"]


def test_progress_is_the_weighted_mean_over_all_stages(stores: Stores) -> None:
    stores.add("j1", width=2)
    first, second = stores.claim(), stores.claim()
    stores.steps.report_step(first.place, "w1", 1.0, "one of two", NOW)
    stores.steps.report_step(second.place, "w1", 0.5, "half of the other", NOW)
    stores.steps.report_step(second.place, "w1", 0.2, "half of the other", NOW)
    job = stores.job("j1")
    assert (job.progress, job.message) == (37, "half of the other")


@pytest.mark.parametrize("end", ["fail", "dismiss"])
def test_of_a_job_that_is_over_no_step_begins_or_is_wanted(stores: Stores, end: str) -> None:
    stores.add("j1", width=2)
    step = stores.claim()
    getattr(stores.jobs, end)("j1", *([{"title": "x"}] if end == "fail" else []), NOW)
    wanted = stores.steps.report_step(step.place, "w1", 0.5, "", NOW)
    assert (wanted, stores.finish(step), stores.take()) == (False, False, None)


def test_a_step_counts_only_for_the_worker_that_has_it(stores: Stores) -> None:
    stores.add("j1")
    step = stores.claim("w1")
    stores.steps.hand_back("w1")
    stores.claim("w2")
    assert (stores.finish(step, "w1"), stores.finish(step, "w2")) == (False, True)


def test_what_a_worker_does_not_compute_is_put_back(stores: Stores) -> None:
    stores.add("j1", width=2)
    kept = stores.claim()
    lost = stores.claim()
    stores.steps.hand_back("w1", [kept.place])
    assert (stores.claim("w2").place, stores.take("w2")) == (lost.place, None)


def test_only_the_steps_that_a_dead_worker_computed_count_its_death(stores: Stores) -> None:
    for number in range(3):
        stores.add(f"j{number}", number)
    stores.claim("w1")
    stores.claim("w2")
    stores.executors.remove("w1")
    lost = stores.steps.tidy(NOW).steps
    deaths = [stores.steps.put_back(each, 1.0, NOW) for each in lost]
    assert (lost, deaths) == ([LostStep(StepPlace("j0", 0, 0), "w1")], [1.0])
    assert [stores.job(f"j{number}").attempts for number in range(3)] == [2, 1, 0]
    assert stores.steps.put_back(lost[0], 1.0, NOW) == 0.0


def test_a_step_of_which_a_worker_died_is_computed_alone(stores: Stores) -> None:
    stores.add("j1")
    stores.add("j2", 1.0)
    stores.claim("w1")
    stores.executors.remove("w1")
    stores.steps.put_back(stores.steps.tidy(NOW).steps[0], 1.0, NOW)
    other = stores.claim("w2", alone=False)
    beside_others = stores.take("w2", alone=False)
    step = stores.claim("w2", alone=True)
    assert (other.place.job_id, beside_others) == ("j2", None)
    assert (step.place.job_id, step.suspect) == ("j1", True)


def test_jobs_that_nobody_has_led_on_are_found(stores: Stores) -> None:
    for job_id in ("j1", "j2"):
        stores.add(job_id)
    stores.add("fresh", 9.0, stage=None)
    stores.finish(stores.claim())
    assert list(stores.steps.tidy(NOW).jobs) == ["j1"]


def test_what_was_waited_for_and_computed_is_counted_and_outlives_the_job(stores: Stores) -> None:
    stores.add("j1", width=2)
    stores.add("j2", 1.0)
    with stores.engine.begin() as connection:
        connection.execute(sa.update(job_steps).values(waiting_since=job_steps.c.waiting_since - 10.0))
    stores.finish(stores.claim())
    stores.claim()
    before = stores.steps.figures()
    stores.jobs.fail("j1", {"title": "No good"}, NOW)
    after = stores.steps.figures()
    assert (before.waiting, before.running, before.longest_wait_s >= 10.0) == (1, 1, True)
    assert (after.waiting, after.running) == (1, 0)
    assert (after.totals["steps"], after.totals["job_failures"]) == ({"nap": 1.0}, {"No good": 1.0})
    assert after.totals["step_wait_seconds"]["nap"] >= 10.0
    assert after.totals["step_seconds"]["nap"] >= 0.0
