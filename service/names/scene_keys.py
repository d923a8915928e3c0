"""Name of the blob that keeps what a viewer shows of a job."""


def scene_key(job_id: str) -> str:
    """Name the blob of a job's scene."""
    return f"jobs/{job_id}/scene.json"
