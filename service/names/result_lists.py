"""Lists of the results of large networks: what they are called, where they belong, and where their rows are kept."""

from collections.abc import Mapping

POINTERS: Mapping[str, tuple[str, ...]] = {
    "stations": ("stations",),
    "pairs": ("pairs",),
    "features": ("features",),
    "links": ("network", "links"),
    "loops": ("network", "loops"),
    "removed": ("network", "adjustment", "removed"),
    "left-out": ("network", "adjustment", "left_out"),
    "precisions": ("tolerance", "stations"),
    "reasons": ("tolerance", "reasons"),
    "comparison": ("comparison",),
    "comparison-summary": ("comparison_summary",),
    "inputs": ("provenance", "inputs"),
    "registered": ("registered",),
}
"""Members from the top of the result document of `register` down, by name of the list."""
STREAMED = ".ndjson"
"""Behind its name: all of a list, one entry a line."""
MEDIA_TYPE = "application/x-ndjson"
ROWS = 50
"""Of one blob: some 5 MB of pairs, 200 kB of stations."""
PAIRS_PER_STATION = 10
"""Of a network whose result is one document at most; pairs that are chosen by their scans are about three."""


def rows_key(job_id: str, name: str, number: int) -> str:
    """Name the blob with the rows from `ROWS * number` on."""
    return f"jobs/{job_id}/lists/{name}/{number:06d}{STREAMED}"


def rows_folder(job_id: str) -> str:
    """Name the folder of all lists of a job."""
    return f"jobs/{job_id}/lists/"


def list_address(job_id: str, name: str) -> str:
    """Give where the pages of a list are."""
    return f"/jobs/{job_id}/results/{name}"


def comes_in_pages(stations: int, pairs: int, most_stations: int) -> bool:
    """Tell whether the result of a registration is too large for one document.

    Parameters
    ----------
    stations, pairs
        How many there are.
    most_stations
        The setting: stations of a network whose result is one document.
    """
    return stations > 2 and (stations > most_stations or pairs > PAIRS_PER_STATION * most_stations)


def placed_key(job_id: str) -> str:
    """Name the blob with stations and features of a large network, for computations that need all of them."""
    return f"jobs/{job_id}/placed.json"
