"""Name of the blob that keeps what a viewer shows of a job."""


def scene_key(job_id: str) -> str:
    """Name the blob of a job's scene."""
    return f"jobs/{job_id}/scene.json"


SCENE_STATIONS, SCENE_PAIRS, SCENE_POINTS = "scene-stations", "scene-pairs", "scene-points"
"""Of a large network: lists with a row for each station, each pair, and each station whose points are kept."""
