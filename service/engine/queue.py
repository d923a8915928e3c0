"""The queues and how jobs get on and off them."""

import json
from collections.abc import Sequence
from typing import Any

import sqlalchemy as sa
from dbos import DBOS, DBOSClient, EnqueueOptions, Serializer, WorkflowStatus

from service.errors import QueueError
from service.ports import ExecutorRegistry, Job, Json
from service.settings import Settings

APPLICATION_NAME = "tieline"
APPLICATION_VERSION = "2"
"""Changed only when the order of steps in a workflow changes, or how jobs are enqueued; jobs of other versions are
begun again at start."""
PROJECT, COMPUTE = "project", "compute"
PROJECT_CONCURRENCY = 64
POLLING_S = {PROJECT: 0.25, COMPUTE: 0.1}
"""Many steps take less than a second, so that waiting for the next look at their queue would double them. Ten looks a
second cost an idle worker 2 % of a processor."""
CLIENT_CONNECTIONS = 2


class JsonSerializer(Serializer):
    """Keep workflow data as JSON, so that no pickle is ever read."""

    def serialize(self, data: Any) -> str:
        """Write JSON; an exception becomes its text."""
        return json.dumps(data, default=lambda value: {"__error__": repr(value)})

    def deserialize(self, serialized_data: str) -> Any:
        """Read JSON; the text of an exception becomes a `QueueError`."""
        return json.loads(serialized_data, object_hook=_revived)

    def name(self) -> str:
        """Name the format in the database."""
        return "tieline_json"


def _revived(document: Json) -> Any:
    return QueueError(document["__error__"]) if set(document) == {"__error__"} else document


def prepare(settings: Settings) -> None:
    """Make or update the engine's tables and queues; once, after the metadata's migrations, before any process."""
    DBOS.migrate(settings.sqlalchemy_url)
    client = _client(settings)
    try:
        _register_queues(client, settings)
    finally:
        client.destroy()


def _client(settings: Settings) -> DBOSClient:
    return DBOSClient(
        system_database_url=settings.sqlalchemy_url,
        system_database_pool_size=CLIENT_CONNECTIONS,
        serializer=JsonSerializer(),
        application_name=APPLICATION_NAME,
        lazy=True,
        retry_connection_errors=False,  # a request is answered that the database is away
    )


def _register_queues(client: DBOSClient, settings: Settings) -> None:
    client.register_queue(
        PROJECT,
        worker_concurrency=PROJECT_CONCURRENCY,
        # owners are served in random order, so that the jobs of one do not keep those of others waiting
        partition_concurrency=settings.max_running_jobs,
        polling_interval_sec=POLLING_S[PROJECT],
    )
    client.register_queue(COMPUTE, worker_concurrency=settings.computations, polling_interval_sec=POLLING_S[COMPUTE])


class DbosQueue:
    """Put jobs on the queue and take them off; in the web process as in a worker."""

    def __init__(self, settings: Settings, executors: ExecutorRegistry) -> None:
        self._client = _client(settings)
        self._executors = executors

    def enqueue(self, connection: sa.Connection, job: Job) -> None:
        """Enqueue a job within the transaction of a connection to the same database."""
        self._client.enqueue_in_transaction(connection, _enqueueing(job), job.id)

    def cancel(self, job_id: str) -> None:
        """Ask that a job's computation stop (within 5 s)."""
        self._client.cancel_workflow(job_id, cancel_children=True)

    def live_workers(self) -> int:
        """Count workers whose heart beats."""
        return len(self._executors.live())

    def take_up_again(self, workflow: WorkflowStatus) -> None:
        """Put a workflow whose worker is gone back on its queue; its finished steps stay finished."""
        self._client.resume_workflow(workflow.workflow_id, queue_name=workflow.queue_name or _queue_of(workflow))

    def list(self, states: Sequence[str], **conditions: Any) -> list[WorkflowStatus]:
        """List workflows without their data."""
        return self._client.list_workflows(status=list(states), load_input=False, load_output=False, **conditions)

    def forget(self, workflow_ids: Sequence[str]) -> None:
        """Remove what is recorded of workflows."""
        self._client.delete_workflows(list(workflow_ids))

    def begin_again(self, job: Job) -> None:
        """Forget what was recorded of a job and enqueue it as if it were new."""
        self._client.delete_workflows([job.id], delete_children=True)
        self._client.enqueue(_enqueueing(job), job.id)

    def close(self) -> None:
        """Close the connections."""
        self._client.destroy()


def _enqueueing(job: Job) -> EnqueueOptions:
    return {
        "workflow_name": PROJECT,
        "queue_name": PROJECT,
        "workflow_id": job.id,
        "app_version": APPLICATION_VERSION,
        "priority": priority_of(job),
        "queue_partition_key": f"project {job.owner}",
    }


def priority_of(job: Job) -> int:
    """Give the place of a job, and of its steps, on the queues: low numbers first, and 0 means something else there."""
    return job.urgency + 1


def job_of(workflow_id: str) -> str:
    """Give the job of a workflow: steps are called ``<job>:<stage>:<index>``."""
    return workflow_id.partition(":")[0]


def _queue_of(workflow: WorkflowStatus) -> str:
    return PROJECT if workflow.name == PROJECT else COMPUTE
