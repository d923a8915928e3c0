"""What the service needs of the world: storage of metadata and blobs, and a queue. Adapters provide it."""

from service.ports.audit import AuditEntry, AuditFilter, AuditLog
from service.ports.blobs import BlobStore, StepFiles
from service.ports.callbacks import (
    CallbackBody,
    CallbackEvent,
    CallbackSender,
    CallbackStore,
    ClaimedCallback,
    Subscription,
)
from service.ports.dispatch import FreshJob, StepSource, StepWork, Turns
from service.ports.documents import Json, JsonText, as_text
from service.ports.files import FileStore, StoredAmount, StoredFile, admit_any_file
from service.ports.idempotency import KEPT_ANSWERS, Answer, Claim, IdempotencyStore
from service.ports.job_steps import ClaimedStep, LeftBehind, LostStep, StepFigures, StepPlace, StepRecords
from service.ports.jobs import (
    USUAL_URGENCY,
    Job,
    JobFilter,
    JobLog,
    JobState,
    JobStatus,
    JobStore,
    LogLine,
    UnfinishedJobs,
    admit_any,
)
from service.ports.keys import Key, KeyStore, Scope, StoredKey
from service.ports.owners import narrowed
from service.ports.processes import Process, Stored
from service.ports.sessions import SessionStore
from service.ports.sources import RemoteFile, Sources
from service.ports.steps import (
    REQUEST_BODY,
    REQUEST_INPUTS,
    Plan,
    RequestReader,
    StepCall,
    StepContext,
    StepFailedError,
    StepProgress,
    StepRunner,
)
from service.ports.uploads import OpenUpload, PendingUpload, UploadState, UploadStore
from service.ports.workers import DeadExecutor, ExecutorRegistry, Queue

__all__ = [
    "KEPT_ANSWERS",
    "REQUEST_BODY",
    "REQUEST_INPUTS",
    "USUAL_URGENCY",
    "Answer",
    "AuditEntry",
    "AuditFilter",
    "AuditLog",
    "BlobStore",
    "CallbackBody",
    "CallbackEvent",
    "CallbackSender",
    "CallbackStore",
    "Claim",
    "ClaimedCallback",
    "ClaimedStep",
    "DeadExecutor",
    "ExecutorRegistry",
    "FileStore",
    "FreshJob",
    "IdempotencyStore",
    "Job",
    "JobFilter",
    "JobLog",
    "JobState",
    "JobStatus",
    "JobStore",
    "Json",
    "JsonText",
    "Key",
    "KeyStore",
    "LeftBehind",
    "LogLine",
    "LostStep",
    "OpenUpload",
    "PendingUpload",
    "Plan",
    "Process",
    "Queue",
    "RemoteFile",
    "RequestReader",
    "Scope",
    "SessionStore",
    "Sources",
    "StepCall",
    "StepContext",
    "StepFailedError",
    "StepFigures",
    "StepFiles",
    "StepPlace",
    "StepProgress",
    "StepRecords",
    "StepRunner",
    "StepSource",
    "StepWork",
    "Stored",
    "StoredAmount",
    "StoredFile",
    "StoredKey",
    "Subscription",
    "Turns",
    "UnfinishedJobs",
    "UploadState",
    "UploadStore",
    "admit_any",
    "admit_any_file",
    "as_text",
    "narrowed",
]
