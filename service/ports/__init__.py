"""What the service needs of the world: storage of metadata and blobs, and a queue. Adapters provide it."""

from service.ports.blobs import BlobStore
from service.ports.documents import Json
from service.ports.files import FileStore, StoredFile
from service.ports.jobs import Job, JobFilter, JobLog, JobStatus, JobStore, LogLine
from service.ports.sources import RemoteFile, Sources
from service.ports.steps import Plan, StepCall, StepContext, StepFailedError, StepLedger, StepProgress, StepRunner
from service.ports.uploads import OpenUpload, PendingUpload, UploadState, UploadStore
from service.ports.workers import ExecutorRegistry, Queue

__all__ = [
    "BlobStore",
    "ExecutorRegistry",
    "FileStore",
    "Job",
    "JobFilter",
    "JobLog",
    "JobStatus",
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
    "StoredFile",
    "UploadState",
    "UploadStore",
]
