"""What the terminal tells of a result."""

from pathlib import Path
from typing import Any

from rich.console import Console

from service.result_tables import MOST_REMOVED, print_report_place, print_result


def told(**pair: Any) -> str:
    result = {
        "status": "registered",
        "pairs": [{"target": "A", "source": "B", "status": "accepted", "reasons": [], **pair}],
        "stations": [],
        "comparison_summary": [
            {
                "station": "B",
                "verdict": "the poses differ",
                "mean_difference_rotation_gon": 0.01234,
                "mean_difference_translation_m": 0.005,
            }
        ],
    }
    console = Console(record=True, width=200)
    print_result(console, result)
    return console.export_text()


def outlier(number: int, change: str = "removed") -> dict[str, Any]:
    return {"line": f"A/L{number} – B/L{number}", "change": change, "why": "moved [between] the scans"}


def test_removed_lines_are_told_with_their_reason() -> None:
    text = told(outliers=[outlier(7), outlier(8, "reinstated")])
    assert "removed A/L7 – B/L7: moved [between] the scans" in text
    assert "L8" not in text


def test_a_line_that_was_put_back_is_not_told_as_removed() -> None:
    assert "L7" not in told(outliers=[outlier(7), outlier(7, "reinstated")])


def test_a_long_list_of_removed_lines_is_cut_and_counted() -> None:
    text = told(outliers=[outlier(k) for k in range(MOST_REMOVED + 3)])
    assert text.count("removed A/") == MOST_REMOVED
    assert "and 3 more" in text


def test_agreement_of_lines_is_told_in_millimetres_and_gon() -> None:
    counts = {"plane_intersections": 20, "cylinder_axes": 3, "photo_edges": 0, "removed": 1}
    text = told(accuracy={"max_offset_m": 0.00123, "max_angle_gon": 0.0456, "lines": counts})
    assert "lines used: 23; largest offset of lines [mm]: 1.23; largest angle of lines [gon]: 0.0456" in text


def test_the_comparison_with_the_reference_stands_before_the_pairs() -> None:
    text = told()
    assert text.index("the poses differ (on average 0.0123 gon, 0.0050 m)") < text.index("B -> A: accepted")


def test_verdict_and_poses_come_before_reasons_and_outliers() -> None:
    keys = ("omega_gon", "phi_gon", "kappa_gon", "tx_m", "ty_m", "tz_m")
    pose = {**dict.fromkeys(keys, 0.0), "std": dict.fromkeys(keys, 0.001)}
    pair = {"target": "A", "source": "B", "status": "accepted", "reasons": ["it fits"], "outliers": [outlier(1)]}
    result = {
        "status": "registered",
        "tolerance": {"verdict": "not-met"},
        "stations": [{"name": "A", "status": "fixed", "world_from_scan": pose},
                     {"name": "B", "status": "registered", "world_from_scan": pose}],
        "pairs": [pair],
    }  # fmt: skip
    console = Console(record=True, width=120)
    print_result(console, result)
    text = console.export_text()
    assert text.startswith("registered; tolerance NOT kept\n")
    assert text.index("B: registered") < text.index("it fits") < text.index("removed A/L1")


def test_of_a_large_network_the_terminal_tells_what_its_lists_come_to() -> None:
    counts = {
        "frame": "S0",
        "stations": {"fixed": 1, "registered": 980, "unregistered": 19},
        "pairs": {"accepted": 2100, "rejected": 1000},
        "links": {"used": 2090, "rejected": 10},
        "loops": 1500,
        "open_loops": 2,
    }
    console = Console(record=True, width=120)
    print_result(console, {"status": "partly-registered", "counts": counts, "lists": {"stations": {}, "pairs": {}}})
    text = console.export_text()
    assert "stations: 1 fixed, 980 registered, 19 unregistered" in text
    assert "loops: 1500, 2 of them open" in text
    assert "stations, pairs (.ndjson)" in text


def test_of_all_pairs_together_five_outliers_are_told() -> None:
    pairs = [
        {"target": "A", "source": f"S{k}", "status": "accepted", "reasons": [], "outliers": [outlier(k)]}
        for k in range(8)
    ]
    console = Console(record=True, width=120)
    print_result(console, {"status": "registered", "pairs": pairs, "stations": []})
    text = console.export_text()
    assert text.count("removed A/") == MOST_REMOVED
    assert "and 3 more removed" in text


def test_the_terminal_says_where_the_report_lies_if_there_is_one(tmp_path: Path) -> None:
    console = Console(record=True, width=400)
    print_report_place(console, tmp_path)
    assert console.export_text() == ""
    (tmp_path / "report.html").write_text("page")
    (tmp_path / "report.pdf").write_text("pdf")
    print_report_place(console, tmp_path)
    assert console.export_text() == f"report: {tmp_path / 'report.html'} (and report.pdf)\n"
