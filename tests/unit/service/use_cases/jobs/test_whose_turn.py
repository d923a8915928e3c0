"""Whose turn it is, among projects and within one."""

from dataclasses import replace
from datetime import UTC, datetime, timedelta

import pytest

from service.use_cases.jobs.turns import ProjectShare, WaitingPlace, before, in_turn

NOW = datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC)
PLACE = WaitingPlace(urgency=3, stage=1, created=NOW, job_id="b", index=1)


def test_the_project_with_the_fewest_running_steps_comes_first() -> None:
    shares = [ProjectShare("two", 2, 1.0), ProjectShare("none", 0, 9.0), ProjectShare("one", 1, 0.0)]
    assert in_turn(shares) == ["none", "one", "two"]


def test_of_projects_with_as_many_the_one_that_was_served_longest_ago_comes_first() -> None:
    assert in_turn([ProjectShare("just now", 1, 9.0), ProjectShare("never", 1, 0.0), ProjectShare("then", 1, 5.0)]) == [
        *("never", "then", "just now")
    ]


@pytest.mark.parametrize(
    "later",
    [
        replace(PLACE, urgency=4, stage=9, created=NOW - timedelta(days=1)),
        replace(PLACE, stage=0, created=NOW - timedelta(days=1)),
        replace(PLACE, created=NOW + timedelta(seconds=1)),
        replace(PLACE, job_id="c", index=0),
        replace(PLACE, stage=9, held_back=True),
        replace(PLACE, index=2),
    ],
    ids=[
        "less urgent",
        "an earlier stage",
        "of a younger job",
        "of another job",
        "held back",
        "further back",
    ],
)
def test_within_a_project_a_step_comes_before_one_that_is(later: WaitingPlace) -> None:
    assert (before(PLACE, later), before(later, PLACE)) == (True, False)
