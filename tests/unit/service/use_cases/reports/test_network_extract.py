"""Of a large network the report shows first what contradicts, then what is known worst."""

from schemas.results.network import NetworkLink
from service.use_cases.reports.network_extract import concern


def link(state: str) -> NetworkLink:
    return NetworkLink(target="A", source="B", state=state)


def test_contradictions_come_first_and_pairs_with_too_little_in_common_last() -> None:
    cases = {
        "too little in common": concern(None, 0.5),
        "known to 9 mm": concern(link("uncontrolled"), 0.009),
        "known to 1 mm": concern(link("used"), 0.001),
        "open in one direction": concern(link("used"), None),
        "doubtful, and agrees": concern(link("confirmed"), 0.001),
        "contradicts others": concern(link("rejected"), 0.001),
        "not connected": concern(link("not-connected"), 0.001),
    }
    assert sorted(cases, key=cases.__getitem__) == [
        "contradicts others",
        "doubtful, and agrees",
        "not connected",
        "open in one direction",
        "known to 9 mm",
        "known to 1 mm",
        "too little in common",
    ]
