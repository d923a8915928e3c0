"""A step needs what its arguments name, of its own job and project, and makes what is its job's."""

import pytest

from service.use_cases.steps.step_needs import needs_of

SCAN, PHOTO = "5" * 64, "6" * 64
FEATURES = f"features/{SCAN}/{'7' * 64}.npz"
SIDE = {"name": "S1", "features": FEATURES, "scan": {"sha256": SCAN, "index": 0}}


def test_features_need_scan_and_photos_and_make_one_blob_which_is_all_they_read_when_it_is_there() -> None:
    arguments = {"sha256": SCAN, "index": 0, "options": {}, "owner": "office", "photos": [{"sha256": PHOTO}]}
    needs = needs_of("features", arguments)
    (key,) = needs.makes
    assert needs.reads == {f"files/{SCAN}", f"files/{PHOTO}", key}
    assert needs.done_before == key
    assert needs_of("features", {**arguments, "owner": "stranger"}).makes != needs.makes


def test_features_of_a_scan_that_is_shown_also_make_the_points_for_the_viewer() -> None:
    arguments = {"sha256": SCAN, "index": 0, "options": {}, "owner": "office"}
    alone, needs = needs_of("features", arguments), needs_of("features", {**arguments, "shown": True})
    points = needs_of("viewer-points", arguments)
    assert needs.makes == alone.makes + points.makes
    assert needs.reads == alone.reads | points.reads
    assert needs.done_before == alone.done_before


def test_a_pair_needs_features_always_and_scans_seldom() -> None:
    needs = needs_of("register-pair", {"job_id": "j1", "target": SIDE, "source": SIDE})
    assert (needs.reads, needs.seldom_reads) == ({FEATURES}, {f"files/{SCAN}"})


def test_points_for_the_viewer_are_made_once_for_all_jobs_of_a_project() -> None:
    arguments = {"name": "S1", "filename": "a.e57", "sha256": SCAN, "index": 0, "owner": "office"}
    needs = needs_of("viewer-points", arguments)
    blocks, listed = needs.makes
    assert (needs.reads, needs.done_before) == ({f"files/{SCAN}", listed}, listed)
    assert needs_of("viewer-points", {**arguments, "name": "S2", "filename": "b.e57"}).makes == (blocks, listed)
    for other in ({"owner": "stranger"}, {"index": 1}, {"unit": "mm"}, {"columns": "x,y,z"}):
        assert set(needs_of("viewer-points", {**arguments, **other}).makes).isdisjoint(needs.makes)


def test_edges_need_their_photo() -> None:
    assert needs_of("detect-edges", {"job_id": "j1", "sha256": PHOTO}).reads == {f"files/{PHOTO}"}


@pytest.mark.parametrize("step", ["report-registration", "a step to come"])
def test_names_of_other_jobs_and_what_a_client_says_are_not_followed(step: str) -> None:
    arguments = {
        "job_id": "j1",
        "pairs": [{"pair": "jobs/j1/pairs/0.json"}, {"pair": "jobs/j10/pairs/0.json"}, {"pair": "/etc/passwd"}],
        "inputs": {"sha256": SCAN, "pair": "jobs/j1/other.json"},
    }
    needs = needs_of(step, arguments)
    assert needs.reads == {"jobs/j1/pairs/0.json"}
    assert needs.seldom_reads == frozenset()


def test_a_plan_may_list_results_of_other_jobs_which_may_be_large() -> None:
    needs = needs_of("compare", {"job_id": "j1", "reads": ["jobs/j0/result.json"]})
    assert needs.reads == {"jobs/j0/result.json", "jobs/j0/placed.json"}


def test_an_inspection_needs_one_file_and_makes_nothing() -> None:
    needs = needs_of("inspect-file", {"key": "incoming/1", "filename": "a", "sha256": SCAN})
    assert (needs.reads, needs.makes) == ({"incoming/1"}, ())


@pytest.mark.parametrize(
    ("key", "allowed"),
    [("jobs/j1/result.json", True), ("jobs/j1/artifacts/a", True), ("jobs/j10/result.json", False), ("jobs/j1", False)],
)
def test_a_step_makes_what_lies_under_its_job(key: str, allowed: bool) -> None:
    assert needs_of("echo", {"job_id": "j1", "inputs": {}}).may_make(key) is allowed
