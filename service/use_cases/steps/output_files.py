"""Files that a step writes for its job: downloads, and outputs that are files.

They lie with the job: ``GET /jobs/{id}/artifacts/{name}`` streams them by ranges, they count for what the project
stores, and go when the job goes.
"""

import errno
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import quote

from schemas.results.registration_result import Artifact
from service.errors import InsufficientStorageError
from service.ports import StepContext
from service.use_cases.limits.free_space import require_free_space

FULL = {errno.ENOSPC, errno.EDQUOT}


@contextmanager
def output_file(context: StepContext, job_id: str, name: str, coming_bytes: int = 0) -> Iterator[Path]:
    """Give a path to write a file of any size to; it becomes a download of the job when all went well, else nothing.

    Parameters
    ----------
    context
        Of the step.
    job_id
        Of the job.
    name
        What the download is called; it replaces one of the same name, as of a step that is computed once more.
    coming_bytes
        How large it will be, about.

    Raises
    ------
    InsufficientStorageError
        The disk has no room for it.
    """
    scratch = context.blobs.scratch()
    try:
        require_free_space(scratch, context.limits.get("min_free_bytes", 0), coming_bytes)
        yield scratch / name
        context.blobs.put_file(_key(job_id, name), scratch / name)
    except OSError as error:
        if error.errno in FULL:
            raise InsufficientStorageError("the disk of this service has no room for what this job writes") from None
        raise
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


def artifact(context: StepContext, job_id: str, name: str, media_type: str) -> Artifact:
    """Describe a download that a step of the job has written.

    Raises
    ------
    FileNotFoundError
        None did.
    """
    size = context.blobs.size(_key(job_id, name))
    return Artifact(name=name, type=media_type, bytes=size, href=f"/jobs/{job_id}/artifacts/{quote(name)}")


def _key(job_id: str, name: str) -> str:
    return f"jobs/{job_id}/artifacts/{name}"
