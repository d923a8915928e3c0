"""Tables of the metadata database, and how to connect to it."""

import math
import time
from contextlib import ExitStack
from datetime import UTC, datetime
from typing import Any

import sqlalchemy as sa

from service.ports import as_text
from service.settings import Settings

POOL_TIMEOUT_S = 10.0
"""How long a request waits for a free connection."""
FRESH_S, FRESH_FOR_WORKERS_S = 5.0, 60.0
"""A connection that was used within this time is used again without asking whether the server is still there; workers
try again what fails."""
KEPT_BY_WORKERS = 2
"""Connections that a worker keeps; it opens more when it needs them, and closes those."""
LASTING = "-c idle_in_transaction_session_timeout=60000 -c lock_timeout=60000"
"""Limits of statements that change the tables themselves, for which another machine may wait."""
PATIENCE = {
    "connect_timeout": 5,
    # a server that is gone without a word (power cut, network) is noticed in half a minute, though it owes nothing
    "keepalives_idle": 10,
    "keepalives_interval": 5,
    "keepalives_count": 3,
    "tcp_user_timeout": 25_000,
    # a process that is stopped in the middle of a transaction must not keep its locks, and a server that is alive says
    # that it is busy before it is taken for silent
    "options": "-c idle_in_transaction_session_timeout=20000 -c lock_timeout=10000 -c statement_timeout=12000",
}
"""What is expected of a PostgreSQL server, in words of its client library."""


class UtcDateTime(sa.types.TypeDecorator[datetime]):
    """Keep aware times: SQLite forgets the zone, so all is stored in UTC."""

    impl = sa.DateTime(timezone=True)
    cache_ok = True

    def process_bind_param(self, value: datetime | None, dialect: sa.Dialect) -> datetime | None:  # noqa: ARG002
        """Convert to UTC; naive times are refused by `astimezone`'s caller being aware."""
        return None if value is None else value.astimezone(UTC)

    def process_result_value(self, value: datetime | None, dialect: sa.Dialect) -> datetime | None:  # noqa: ARG002
        """Put the zone back."""
        if value is None:
            return None
        return value.replace(tzinfo=UTC) if value.tzinfo is None else value.astimezone(UTC)


metadata = sa.MetaData()

jobs = sa.Table(
    "jobs",
    metadata,
    sa.Column("id", sa.String(64), primary_key=True),
    sa.Column("process_id", sa.String(64), nullable=False),
    sa.Column("inputs", sa.JSON, nullable=False),
    sa.Column("status", sa.String(16), nullable=False, index=True),
    sa.Column("created", UtcDateTime, nullable=False, index=True),
    sa.Column("started", UtcDateTime),
    sa.Column("finished", UtcDateTime),
    sa.Column("updated", UtcDateTime),
    sa.Column("progress", sa.Integer, nullable=False),
    sa.Column("message", sa.Text, nullable=False),
    sa.Column("attempts", sa.Integer, nullable=False),
    sa.Column("problem", sa.JSON(none_as_null=True)),
    sa.Column("total_weight", sa.Float, nullable=False, server_default="0"),
    sa.Column("wanted", sa.JSON(none_as_null=True)),
    sa.Column("subscriber", sa.JSON(none_as_null=True)),
    sa.Column("fetches", sa.JSON(none_as_null=True)),
    sa.Column("owner", sa.String(64), nullable=False, server_default=""),
    sa.Column("urgency", sa.Integer, nullable=False, server_default="3"),
    sa.Column("request_id", sa.String(128), nullable=False, server_default=""),
    # null: not counted yet
    sa.Column("result_bytes", sa.BigInteger),
    # by which order of steps it was begun; 0: it was not
    sa.Column("planned", sa.Integer, nullable=False, server_default="0"),
    sa.Index("ix_jobs_planned_status", "planned", "status", "owner", "urgency", "created"),
    sa.Column("input_bytes", sa.BigInteger, nullable=False, server_default="0"),
    # virtual time at which it begins; null: it is not offered to workers
    sa.Column("turn", sa.BigInteger),
    sa.Index("ix_jobs_owner_created", "owner", "created"),
    sa.Index("ix_jobs_owner_result_bytes", "owner", "result_bytes"),
    sa.Index("ix_jobs_result_bytes", "result_bytes"),
    sa.Index("ix_jobs_owner_input_bytes", "owner", "input_bytes"),
)

job_files = sa.Table(
    "job_files",
    metadata,
    sa.Column("job_id", sa.String(64), sa.ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True),
    sa.Column("position", sa.Integer, primary_key=True),
    sa.Column("file_id", sa.String(64), nullable=False, index=True),
)

job_steps = sa.Table(
    "job_steps",
    metadata,
    sa.Column("job_id", sa.String(64), sa.ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True),
    sa.Column("stage", sa.Integer, primary_key=True),
    sa.Column("position", sa.Integer, primary_key=True),
    sa.Column("weight", sa.Float, nullable=False),
    sa.Column("fraction", sa.Float, nullable=False),
    sa.Column("name", sa.String(64), nullable=False),
    sa.Column("arguments", sa.JSON, nullable=False),
    sa.Column("label", sa.Text, nullable=False),
    # waiting, running or done
    sa.Column("state", sa.String(16), nullable=False),
    # who computes, or has computed it
    sa.Column("executor", sa.String(128)),
    sa.Column("waiting_since", sa.Float, nullable=False),
    sa.Column("begun", sa.Float),
    sa.Column("ended", sa.Float),
    # workers that died while they computed it
    sa.Column("deaths", sa.Float, nullable=False),
    sa.Column("output", sa.JSON(none_as_null=True)),
    sa.Index("ix_job_steps_state", "state", "job_id"),
)

turns = sa.Table(
    "turns",
    metadata,
    sa.Column("owner", sa.String(64), primary_key=True),
    # when a step of this project was begun last
    sa.Column("begun", sa.Float, nullable=False),
)

totals = sa.Table(
    "totals",
    metadata,
    sa.Column("name", sa.String(64), primary_key=True),
    sa.Column("label", sa.String(64), primary_key=True),
    sa.Column("value", sa.Float, nullable=False),
)

job_log = sa.Table(
    "job_log",
    metadata,
    # SQLite numbers rows by itself only when the key is its own INTEGER
    sa.Column("id", sa.BigInteger().with_variant(sa.Integer, "sqlite"), primary_key=True, autoincrement=True),
    sa.Column("job_id", sa.String(64), sa.ForeignKey("jobs.id", ondelete="CASCADE"), nullable=False, index=True),
    sa.Column("time", UtcDateTime, nullable=False),
    sa.Column("level", sa.String(16), nullable=False),
    sa.Column("text", sa.Text, nullable=False),
)

files = sa.Table(
    "files",
    metadata,
    sa.Column("id", sa.String(64), primary_key=True),
    sa.Column("name", sa.Text, nullable=False),
    sa.Column("bytes", sa.BigInteger, nullable=False),
    sa.Column("sha256", sa.String(64), nullable=False),
    sa.Column("format", sa.String(32), nullable=False),
    sa.Column("kind", sa.String(16), nullable=False),
    sa.Column("created", UtcDateTime, nullable=False, index=True),
    sa.Column("expires", UtcDateTime),
    sa.Column("scans", sa.JSON, nullable=False),
    sa.Column("photos", sa.JSON, nullable=False),
    sa.Column("owner", sa.String(64), nullable=False, server_default=""),
    sa.Column("computed_bytes", sa.BigInteger, nullable=False, server_default="0"),
    sa.Index("ix_files_owner_created", "owner", "created"),
)

keys = sa.Table(
    "keys",
    metadata,
    sa.Column("id", sa.String(32), primary_key=True),
    sa.Column("name", sa.String(64), nullable=False),
    sa.Column("project", sa.String(64), nullable=False),
    sa.Column("scopes", sa.JSON, nullable=False),
    sa.Column("hash", sa.String(200), nullable=False),
    sa.Column("created", UtcDateTime, nullable=False),
    sa.Column("expires", UtcDateTime),
    sa.Column("revoked", UtcDateTime),
    sa.Column("last_used", UtcDateTime),
)

session_secret = sa.Table(
    "session_secret",
    metadata,
    # there is one row
    sa.Column("id", sa.Integer, primary_key=True, autoincrement=False),
    sa.Column("value", sa.LargeBinary, nullable=False),
)

ended_sessions = sa.Table(
    "ended_sessions",
    metadata,
    sa.Column("id", sa.String(64), primary_key=True),
    # by then it would have run out by itself
    sa.Column("until", UtcDateTime, nullable=False, index=True),
)

audit = sa.Table(
    "audit",
    metadata,
    # SQLite numbers rows by itself only when the key is its own INTEGER
    sa.Column("id", sa.BigInteger().with_variant(sa.Integer, "sqlite"), primary_key=True, autoincrement=True),
    sa.Column("time", UtcDateTime, nullable=False, index=True),
    sa.Column("key_id", sa.String(32), nullable=False),
    sa.Column("project", sa.String(64), nullable=False, index=True),
    sa.Column("remote", sa.String(64), nullable=False),
    sa.Column("method", sa.String(16), nullable=False),
    sa.Column("path", sa.Text, nullable=False),
    sa.Column("status", sa.Integer, nullable=False),
    sa.Column("request_id", sa.String(128), nullable=False),
)

idempotency = sa.Table(
    "idempotency",
    metadata,
    sa.Column("owner", sa.String(64), primary_key=True),
    sa.Column("key", sa.String(255), primary_key=True),
    sa.Column("created", UtcDateTime, nullable=False, index=True),
    sa.Column("seed", sa.String(32), nullable=False),
    sa.Column("holder", sa.String(32), nullable=False),
    sa.Column("held_until", sa.Float, nullable=False),
    sa.Column("fingerprint", sa.String(64)),
    sa.Column("status", sa.Integer),
    sa.Column("headers", sa.JSON(none_as_null=True)),
    sa.Column("body", sa.LargeBinary),
)

callbacks = sa.Table(
    "callbacks",
    metadata,
    sa.Column("job_id", sa.String(64), sa.ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True),
    sa.Column("event", sa.String(16), primary_key=True),
    sa.Column("uri", sa.Text, nullable=False),
    sa.Column("host", sa.String(255), nullable=False),
    # null: nothing more is to be told
    sa.Column("due", sa.Float, index=True),
    sa.Column("claimed_by", sa.String(128)),
    sa.Column("attempts", sa.Integer, nullable=False),
    sa.Column("delivered", sa.Integer, nullable=False),
    sa.Column("told", UtcDateTime),
)

uploads = sa.Table(
    "uploads",
    metadata,
    sa.Column("id", sa.String(64), primary_key=True),
    sa.Column("owner", sa.String(64), nullable=False, index=True),
    sa.Column("record", sa.JSON, nullable=False),
    sa.Column("arrived", sa.BigInteger, nullable=False),
    sa.Column("touched", sa.Float, nullable=False),
    sa.Column("holder", sa.String(32), nullable=False),
    sa.Column("held_until", sa.Float, nullable=False),
    sa.Column("wanted", sa.Boolean, nullable=False),
)

upload_parts = sa.Table(
    "upload_parts",
    metadata,
    sa.Column("upload_id", sa.String(64), sa.ForeignKey("uploads.id", ondelete="CASCADE"), primary_key=True),
    sa.Column("start", sa.BigInteger, primary_key=True, autoincrement=False),
    sa.Column("bytes", sa.BigInteger, nullable=False),
    sa.Column("holder", sa.String(32), nullable=False),
)

executors = sa.Table(
    "executors",
    metadata,
    sa.Column("id", sa.String(128), primary_key=True),
    sa.Column("host", sa.Text, nullable=False),
    sa.Column("pid", sa.Integer, nullable=False),
    sa.Column("process_started", sa.Float, nullable=False),
    sa.Column("heartbeat", sa.Float, nullable=False),
    # the process that keeps it running, with which it dies
    sa.Column("launcher_pid", sa.Integer),
    sa.Column("launcher_started", sa.Float),
)

leases = sa.Table(
    "leases",
    metadata,
    sa.Column("name", sa.String(32), primary_key=True),
    sa.Column("holder", sa.String(128), nullable=False),
    sa.Column("expires", sa.Float, nullable=False),
)


def lock_name(connection: sa.Connection, name: str) -> None:
    """Let no other transaction have the same name until this one ends; on SQLite every writing transaction is alone."""
    if connection.dialect.name == "postgresql":
        connection.execute(sa.select(sa.func.pg_advisory_xact_lock(sa.func.hashtextextended(name, 0))))


def connect(settings: Settings, *, reserve: bool = False, fresh_s: float = 0.0, lasting: bool = False) -> sa.Engine:
    """Make the engine of the metadata database (embedded SQLite or PostgreSQL).

    Parameters
    ----------
    settings
        Where it is, and how many connections there may be.
    reserve
        Keep all connections once they are open, so that nobody else takes them (see `reserve_connections`).
    fresh_s
        Within this time a connection is used again without asking whether the server is still there.
    lasting
        Statements may take as long as they want, as those do that change the tables themselves.
    """
    url = sa.make_url(settings.sqlalchemy_url)
    if url.get_backend_name() != "sqlite":
        # only here: its client library takes memory
        from service.adapters.database.silent_servers import ANSWERS_WITHIN_S, give_up_when_silent

        most = settings.database_connections
        kept = most if reserve else min(KEPT_BY_WORKERS, most)
        server = sa.create_engine(
            url,
            json_serializer=as_text,
            pool_size=kept,
            max_overflow=most - kept,
            pool_timeout=POOL_TIMEOUT_S,
            # those that are not needed stay unused, and need not be asked for
            pool_use_lifo=True,
            connect_args={**PATIENCE, "options": LASTING} if lasting else PATIENCE,
            execution_options={"most_given_jobs": settings.max_running_jobs} if settings.gives_steps else {},
        )
        give_up_when_silent(server, math.inf if lasting else ANSWERS_WITHIN_S)
        _ask_after_a_pause(server, fresh_s)
        return server
    settings.data_dir.mkdir(parents=True, exist_ok=True)
    engine = sa.create_engine(url, json_serializer=as_text)

    @sa.event.listens_for(engine, "connect")
    def _configure(connection: Any, _record: Any) -> None:
        # transactions are begun explicitly below; pysqlite would begin them late and deadlock writers
        connection.isolation_level = None
        # the first: it is for files that are still empty
        for pragma in ("auto_vacuum=INCREMENTAL", "busy_timeout=10000", "journal_mode=WAL", "foreign_keys=ON"):
            connection.execute(f"PRAGMA {pragma}").close()

    @sa.event.listens_for(engine, "begin")
    def _begin(connection: sa.Connection) -> None:
        reads = connection.get_execution_options().get("reads_only", False)
        connection.exec_driver_sql("BEGIN" if reads else "BEGIN IMMEDIATE")

    return engine


def reserve_connections(engine: sa.Engine) -> None:
    """Open all connections that an engine keeps, while the server has some left.

    Raises
    ------
    sqlalchemy.exc.OperationalError
        It has none left.
    """
    if isinstance(engine.pool, sa.QueuePool) and engine.dialect.name == "postgresql":
        with ExitStack() as opened:
            for _ in range(engine.pool.size()):
                opened.enter_context(engine.connect())


def _ask_after_a_pause(engine: sa.Engine, fresh_s: float) -> None:
    """Ask a connection that nobody has used for a while whether its server is still there.

    To ask before each use would double the number of transactions.
    """
    from service.adapters.database.silent_servers import ping

    @sa.event.listens_for(engine, "checkin")
    def _note(_connection: Any, record: Any) -> None:
        record.info["used"] = time.monotonic()

    @sa.event.listens_for(engine, "checkout")
    def _ask(connection: Any, record: Any, _proxy: Any) -> None:
        used = record.info.get("used")
        if used is None or time.monotonic() - used < fresh_s:
            return
        try:
            ping(engine, connection)
        except engine.dialect.loaded_dbapi.Error as error:
            raise sa.exc.DisconnectionError from error


def connect_reader(engine: sa.Engine) -> sa.Engine:
    """Make a second engine of the same embedded database, for single reads outside transactions that wait for no lock.

    It is disposed of with the first one.
    """
    reader = sa.create_engine(engine.url)

    @sa.event.listens_for(reader, "connect")
    def _configure(connection: Any, _record: Any) -> None:
        connection.isolation_level = None
        for pragma in ("busy_timeout=0", "query_only=ON"):
            connection.execute(f"PRAGMA {pragma}").close()

    @sa.event.listens_for(engine, "engine_disposed")
    def _dispose(_engine: sa.Engine) -> None:
        reader.dispose()

    return reader
