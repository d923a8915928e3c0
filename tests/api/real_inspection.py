"""Steps of the web application that look at uploads as the service does, in the same process."""

import asyncio
from collections.abc import Callable
from typing import Any

from algorithms.progress import NoProgress
from service.ports import StepContext
from service.use_cases.steps.run_features import inspect_uploaded_file
from tests.doubles.memory import MemoryBlobStore

LIMITS = {"max_points": 1_000_000, "max_photo_pixels": 1_000_000}


class RealInspection:
    """Run the inspection of uploads, and nothing else."""

    def __init__(self, blobs: MemoryBlobStore) -> None:
        self._context = StepContext(blobs, NoProgress(), LIMITS)

    async def run(
        self,
        step: str,
        arguments: dict[str, Any],
        *,
        timeout_s: float,  # noqa: ARG002 - the port's signature
        on_progress: Callable[[float, str], None] | None = None,  # noqa: ARG002
    ) -> dict[str, Any]:
        assert step == "inspect-file"
        return await asyncio.to_thread(inspect_uploaded_file, self._context, arguments)
