"""Settings of the service, read once from the environment (prefix ``TIELINE_``) in `__main__`."""

import os
import sys
from pathlib import Path
from typing import Literal

from pydantic import Field, field_validator, model_validator
from pydantic_settings import BaseSettings, SettingsConfigDict

from schemas.requests.callback_secret import CallbackSecret

GIGABYTE = 1_000_000_000
POSTGRESQL = "postgresql+psycopg"
"""Name of the database with its driver."""


class Settings(BaseSettings):
    """How this service runs. Every field is an environment variable with the prefix ``TIELINE_``."""

    model_config = SettingsConfigDict(env_prefix="TIELINE_", frozen=True, extra="ignore")

    data_dir: Path = Path("tieline-data")
    """Where files, results and the embedded database live."""
    database_url: str = ""
    """Database of metadata and queue: ``postgresql://user:password@host/database``; empty: SQLite in `data_dir`."""
    storage_url: str = ""
    """Where files and results are kept: ``s3://bucket/prefix?endpoint=https://host:port&region=name`` (credentials in
    the usual ``AWS_…`` variables), ``file:///directory``; empty: in `data_dir`."""
    cache_bytes: int = Field(default=50 * GIGABYTE, ge=0)
    """Most bytes of copies from an object store on this machine; those in use may exceed it."""
    database_connections: int = Field(default=4, ge=2)
    """Most connections of one process to PostgreSQL. An API process opens them at its start and keeps them; a worker
    keeps two."""
    host: str = "127.0.0.1"
    """Address to bind to."""
    port: int = Field(default=8765, ge=0, le=65535)
    """Port to bind to."""
    public_url: str = ""
    """Base of all links when the service stands behind a proxy; empty: as the request says."""
    trusted_proxies: str = ""
    """Addresses and networks of proxies, separated by commas, that are believed who asks (`X-Forwarded-For`) and how
    (`X-Forwarded-Proto`); empty: those in `FORWARDED_ALLOW_IPS`, and without it none."""
    api_processes: int = Field(default=1, ge=1)
    """API processes that `tieline serve` starts."""
    workers: int = Field(default=1, ge=0)
    """Worker processes that `tieline serve` starts; more than one need PostgreSQL."""
    slots: int = Field(default=0, ge=0)
    """Computations side by side in one worker; 0: two where there are two cores, with all cores for each: while one
    reads its file on one core, the other computes."""
    threads: int = Field(default=0, ge=0)
    """Threads per computation; 0: all cores divided by the slots that are asked for."""
    niceness: int = Field(default=5, ge=0, le=19)
    """How far computations, and the writing of uploads, step back behind all else on this machine: 0, not at all, as
    where a command starts the service for itself, to 19; each step costs a fifth of their share of a processor."""
    nursery: bool = True
    """Keep a process with the libraries loaded, of which computations are copies (Linux); else each loads its own."""
    confine_children: bool = True
    """Let each computation see the files that it reads, and the libraries, only, write to a directory of its own only,
    and reach no network unless it fetches a file, where the kernel can do it (Linux: Landlock, seccomp)."""
    max_file_bytes: int = Field(default=20 * GIGABYTE, ge=1)
    """Largest upload."""
    max_points: int = Field(default=200_000_000, ge=1)
    """Most points of one scan."""
    max_photo_pixels: int = Field(default=100_000_000, ge=1)
    """Most pixels of one photo."""
    max_stations: int = Field(default=5000, ge=2)
    """Most stations of one job: of 5000 the adjustment takes 2.6 GB, the report 0.6 GB; some 16 000 pairs are tried."""
    max_whole_stations: int = Field(default=500, ge=1)
    """Most stations of a network whose result is one document; of more, stations, pairs and the like come page by page
    or as a stream."""
    max_network_observations: int = Field(default=400_000, ge=1)
    """Most observed numbers of one network that is adjusted."""
    max_queued_jobs: int = Field(default=10_000, ge=1)
    """Most unfinished jobs of all projects together."""
    max_project_jobs: int = Field(default=2000, ge=1)
    """Most unfinished jobs of one project."""
    max_running_jobs: int = Field(default=64, ge=1)
    """Most jobs of one project that are worked on at the same time; others wait, and let those of other projects by."""
    max_project_files: int = Field(default=100_000, ge=1)
    """Most files that one project may have."""
    max_project_bytes: int = Field(default=1000 * GIGABYTE, ge=1)
    """Most bytes that one project may store: files with what was computed of them (features, points for the viewer),
    uploads on their way, results and downloads of jobs; content that is stored once for several files counts for each.
    A project with more begins no upload and no job."""
    max_project_uploads: int = Field(default=1000, ge=1)
    """Most resumable uploads of one project that are begun, or were refused and are not removed yet."""
    max_project_records_bytes: int = Field(default=2 * GIGABYTE, ge=1)
    """Most bytes of one project in the database: inputs of jobs, kept answers to repeated requests, and 300 for each of
    its entries in the audit log."""
    auth: Literal["auto", "required", "off"] = "auto"
    """Whether requests need a key: `auto`, as soon as one was made (and then for ever, also when all are revoked);
    `required`, always; `off`, never, on any address."""
    max_requests_per_minute: int = Field(default=6000, ge=1)
    """Most requests with one key, counted by each API process for itself."""
    max_address_requests_per_minute: int = Field(default=6000, ge=1)
    """Most requests from one address (of IPv6: from one /64) to what needs no key, once keys are needed for the rest;
    counted by each API process for itself."""
    max_key_checks_per_minute: int = Field(default=60, ge=1)
    """Most wrong keys from one address (of IPv6: from one /64) that an API process looks at, counted for each key that
    exists by itself: who has another one is not locked out."""
    audit_days: int = Field(default=400, ge=1)
    """How long it is kept who changed what."""
    audit_refused_days: int = Field(default=7, ge=1)
    """How long it is kept who was turned away."""
    min_free_bytes: int = Field(default=GIGABYTE, ge=0)
    """Uploads are refused (507) when less would remain free on the disk."""
    allowed_sources: str = ""
    """Beginnings of the addresses from which scans and photos may be fetched (`"scan": {"href": …}`), separated by
    commas, such as ``https://data.example.org/scans/`` or, with the credentials in the usual ``AWS_…`` variables,
    ``s3://bucket/prefix?endpoint=https://host:port&region=name``; empty: none."""
    allow_private_sources: bool = False
    """Allow these addresses to be those of private networks and of this machine."""
    callback_secret: Literal[""] | CallbackSecret = Field(default="", repr=False)
    """From which the secrets are derived that sign callbacks, one for each project, receiver and process (`tieline keys
    callback` tells them), and the key that encrypts secrets which subscribers bring: `whsec_` and a key in base64, or
    any text of 16 characters or more; empty: only callbacks whose subscriber brought a secret are signed, and with
    PostgreSQL such secrets are refused."""
    allow_private_callbacks: bool = False
    """Allow callbacks to addresses of private networks and of this machine."""
    callback_ports: str = Field(default="80,443,8080,8443", pattern=r"^\s*(\d{1,5}\s*(,\s*\d{1,5}\s*)*)?$")
    """Ports to which callbacks may go; empty: all."""
    callback_timeout_s: int = Field(default=30, ge=1)
    """How long the receiver of a callback may take, and a second more for every 100 kB."""
    callback_attempts: int = Field(default=12, ge=1)
    """How often a callback is tried before it is given up."""
    callback_back_off_s: float = Field(default=5.0, gt=0.0)
    """Pause after the first failed try of a callback; doubled after each further one, up to an hour."""
    callback_interval_s: float = Field(default=10.0, gt=0.0)
    """Shortest time between two callbacks that tell how far a job is."""
    queue: Literal["own", "procrastinate"] = "own"
    """How workers get steps from PostgreSQL: `own`, they ask; `procrastinate`, that library gives them (on trial; all
    processes of a service say the same)."""
    header_timeout_s: int = Field(default=20, ge=1)
    """Longest time from the first byte of a request, or from the connection, to the end of its headers."""
    body_timeout_s: int = Field(default=60, ge=1)
    """Longest silence of a client in the middle of a request, or in reading its answer; a body that brings less than
    500 bytes per second over so long is given up as well."""
    upload_expiry_s: int = Field(default=86_400, ge=60)
    """How long an unfinished upload waits to be continued, and anything half-done to be finished, before removal."""
    clean_up_interval_s: int = Field(default=600, ge=1)
    """Time between two searches for unfinished and orphaned content."""
    step_timeout_s: int = Field(default=3600, ge=1)
    """Longest run of one computation."""
    step_memory_bytes: int = Field(default=16 * GIGABYTE, ge=GIGABYTE)
    """Most memory of one computation above what the libraries need; less where the machine, or the control group, has
    less: four fifths of its memory are divided among all computations and inspections that may run side by side."""
    inspect_timeout_s: int = Field(default=300, ge=1)
    """Longest inspection of an uploaded file."""
    inspect_wait_s: int = Field(default=300, ge=1)
    """How long an upload waits for its inspection, one of its project and some of all being under way, before it is
    refused (503)."""
    inspections: int = Field(default=0, ge=0)
    """Inspections side by side on this machine, one of which is left to other projects where there are several; 0: one
    a core, and two at least, while each has a gigabyte of memory."""
    max_attempts: int = Field(default=3, ge=1)
    """How many workers may die while they compute the same step before its job counts as poison and fails."""

    @property
    def computations(self) -> int:
        """Give the number of computations side by side in one worker."""
        return self.slots or min(2, _cores())

    @property
    def threads_per_computation(self) -> int:
        """Give the number of threads of one computation."""
        return self.threads or max(1, _cores() // max(self.slots, 1))

    @property
    def source_beginnings(self) -> tuple[str, ...]:
        """Give the beginnings of the addresses from which files may be fetched."""
        return tuple(text.strip() for text in self.allowed_sources.split(",") if text.strip())

    @property
    def embedded_database(self) -> bool:
        """Tell whether the database is a file of this machine."""
        return self.sqlalchemy_url.startswith("sqlite")

    @property
    def gives_steps(self) -> bool:
        """Check whether workers are given their steps."""
        return self.queue == "procrastinate" and not self.embedded_database

    @property
    def sqlalchemy_url(self) -> str:
        """Give the database's URL, with its driver, and with the embedded default filled in."""
        if not self.database_url:
            return f"sqlite:///{(self.data_dir / 'tieline.sqlite').resolve()}"
        scheme, _, rest = self.database_url.partition("://")
        return f"{POSTGRESQL}://{rest}" if scheme in {"postgres", "postgresql"} else self.database_url

    @model_validator(mode="after")
    def _has_one_worker_where_embedded(self) -> "Settings":
        if self.workers > 1 and self.embedded_database:
            raise ValueError(
                f"{self.workers} workers need PostgreSQL (TIELINE_DATABASE_URL); one computes several steps side by "
                "side (TIELINE_SLOTS)"
            )
        return self

    @field_validator("storage_url")
    @classmethod
    def _is_storage(cls, url: str) -> str:
        if url and not url.startswith(("s3://", "file:///")):
            raise ValueError("storage is given as s3://bucket/prefix or file:///directory")
        return url

    @field_validator("database_url")
    @classmethod
    def _is_known(cls, url: str) -> str:
        if url and url.partition("://")[0] not in {"postgres", "postgresql", POSTGRESQL, "sqlite"}:
            raise ValueError("a database is given as postgresql://user:password@host/database")
        return url


def _cores() -> int:
    """Count the cores that this process may use."""
    return len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1
