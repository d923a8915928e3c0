"""What the service needs of the world: storage of metadata and blobs, and a queue. Adapters provide it."""

from service.ports.audit import AuditEntry, AuditFilter, AuditLog
from service.ports.blobs import BlobStore
from service.ports.documents import Json
from service.ports.files import FileStore, StoredAmount, StoredFile, admit_any_file
from service.ports.jobs import (
    USUAL_URGENCY,
    Job,
    JobFilter,
    JobLog,
    JobStatus,
    JobStore,
    LogLine,
from service.ports.idempotency import KEPT_ANSWERS, Answer, Claim, IdempotencyStore
    UnfinishedJobs,
    admit_any,
)
from service.ports.owners import narrowed
from service.ports.sources import RemoteFile, Sources
from service.ports.steps import Plan, StepCall, StepContext, StepFailedError, StepLedger, StepProgress, StepRunner
from service.ports.uploads import OpenUpload, PendingUpload, UploadState, UploadStore
from service.ports.workers import ExecutorRegistry, Queue

__all__ = [
    "USUAL_URGENCY",
from service.ports.keys import Key, KeyStore, Scope, StoredKey
    "BlobStore",
    "ExecutorRegistry",
    "FileStore",
    "Job",
    "JobFilter",
    "JobLog",
    "JobStatus",
    "KEPT_ANSWERS",
    "JobStore",
    "Json",
    "LogLine",
    "OpenUpload",
    "PendingUpload",
    "Plan",
    "Queue",
    "RemoteFile",
    "Sources",
    "StepCall",
    "StepContext",
    "StepFailedError",
    "StepLedger",
    "StepProgress",
    "StepRunner",
    "StoredAmount",
    "StoredFile",
    "UnfinishedJobs",
    "UploadState",
    "UploadStore",
    "admit_any",
    "Key",
    "KeyStore",
    "admit_any_file",
    "narrowed",
]
    "Scope",
    "Subscription",
    "StoredKey",
