"""What the web process sees of the queue, in the metadata database."""

from service.ports import ExecutorRegistry, StepFigures, StepRecords


class DatabaseQueue:
    """Look at workers and steps.

    Parameters
    ----------
    executors
        The workers.
    steps
        The steps.
    """

    def __init__(self, executors: ExecutorRegistry, steps: StepRecords) -> None:
        self._executors = executors
        self._steps = steps

    def live_workers(self) -> int:
        """Count workers whose heart beats."""
        return len(self._executors.live())

    def figures(self) -> StepFigures:
        """Tell how it stands with steps."""
        return self._steps.figures()
