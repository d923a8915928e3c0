"""What a request says of its report and its tolerance: stored as it was said, refused with its place."""

from collections.abc import Callable
from typing import Any

import httpx
import pytest

from service.dependencies import Adapters
from tests.api.conftest import Client
from tests.api.test_registrations import with_options

Pointers = Callable[[httpx.Response], list[str]]


def test_an_order_is_kept_with_the_job(client: Client, adapters: Adapters) -> None:
    order = {"report": {"project": "Umbau", "lang": "de"}, "tolerance": {"std_m": 0.003}}
    answer = client.post("/registrations", files=with_options(order))
    job = adapters.jobs.get(answer.json()["jobID"])
    assert job is not None
    assert job.inputs["report"]["project"] == "Umbau"
    assert job.inputs["report"]["lang"] == "de"
    assert job.inputs["tolerance"] == {"std_m": 0.003, "std_gon": None}


@pytest.mark.parametrize(
    ("wrong", "pointer"),
    [
        ({"report": {"lang": "fr"}}, "report/lang"),
        ({"report": {"projekt": "x"}}, "report/projekt"),
        ({"report": {"client": "a\nb"}}, "report/client"),
        ({"report": {"remarks": "a\x00b"}}, "report/remarks"),
        ({"tolerance": {}}, "tolerance"),
        ({"tolerance": {"std_m": -1.0}}, "tolerance/std_m"),
        ({"tolerance": {"std_gon": 1e9}}, "tolerance/std_gon"),
    ],
)
def test_an_order_that_makes_no_sense_is_refused_with_its_place(
    client: Client, pointers: Pointers, wrong: dict[str, Any], pointer: str
) -> None:
    answer = client.post("/registrations", files=with_options(wrong))
    assert answer.status_code == 400
    assert [place for place in pointers(answer) if place.endswith(pointer)]
