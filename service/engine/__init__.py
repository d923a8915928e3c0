"""What a worker does: it computes the steps of jobs, one after the other or some side by side, in their order.

The database is the queue. A job is led by nobody: whoever finishes the last step of a stage asks the job's plan what
comes next, and puts that on the queue. A step runs in a child process; what finished is recorded and never repeated;
what a dead worker left is computed by another. A database that is away is waited for.
"""

from service.engine.claiming import ClaimedSteps
from service.engine.execution import Engine
from service.engine.tools import Tools

__all__ = ["ClaimedSteps", "Engine", "Tools"]
