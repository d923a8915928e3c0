"""`tieline keys`: make, revoke and list the keys of a service, on the machine that has its database."""

import os
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta

from rich.console import Console

from service.adapters.database.jobs import migrate
from service.adapters.database.keys import DatabaseKeyStore
from service.adapters.database.tables import connect
from service.errors import FieldFault, InvalidRequestError
from service.ports import Key
from service.processes import OFFERED_PROCESSES
from service.refusals import NoSuchKeyError
from service.settings import Settings
from service.use_cases.access.manage_keys import create_key, revoke_key, shown_project
from service.use_cases.callbacks.callback_signatures import UNSIGNED, derived_secret

DAYS = re.compile(r"([1-9][0-9]{0,4})d")
MOST_LISTED = 10_000


@contextmanager
def opened_keys(settings: Settings) -> Iterator[DatabaseKeyStore]:
    """Give the keys of the service that has these settings, whether it runs or not."""
    os.umask(0o077)
    migrate(settings)
    database = connect(settings)
    try:
        yield DatabaseKeyStore(database)
    finally:
        database.dispose()


def callback_secret(settings: Settings, receiver: str, project: str, process_id: str) -> str:
    """Give the secret that signs what a receiver is told of a project's jobs.

    Raises
    ------
    InvalidRequestError
        The service signs nothing, or not this.
    """
    if not settings.callback_secret:
        raise InvalidRequestError(
            "TIELINE_CALLBACK_SECRET is not set: the service signs nothing in its operator's name"
        )
    if process_id in UNSIGNED or process_id not in OFFERED_PROCESSES:
        raise InvalidRequestError(f"results of '{process_id}' are not signed in the operator's name")
    if not re.match(r"https?://[^/]", receiver):
        raise InvalidRequestError(f"'{receiver}' is no address of a receiver: https://host or https://host:port")
    return derived_secret(settings.callback_secret, project, receiver, process_id)


def make_key(
    settings: Settings, name: str, project: str | None, scopes: str, expires: str | None, console: Console
) -> str:
    """Make a key, tell what it is good for, and give its secret.

    Raises
    ------
    InvalidRequestError, KeyNameTakenError
        It cannot be made like this.
    """
    now = datetime.now(UTC)
    wanted = [scope.strip() for scope in scopes.split(",") if scope.strip()]
    with opened_keys(settings) as keys:
        key, secret = create_key(name, project, wanted, None if expires is None else _moment(expires, now), keys, now)
    until = f", until {key.expires:%Y-%m-%d %H:%M} UTC" if key.expires else ""
    console.print(
        f"key {key.id} '{key.name}' of the project '{shown_project(key.project)}' for "
        f"{', '.join(sorted(key.scopes))}{until}; it is shown once:",
        markup=False,
        highlight=False,
        soft_wrap=True,
    )
    return secret


def revoke(settings: Settings, name_or_id: str, console: Console) -> None:
    """Revoke a key by its id, or by its name if that is valid.

    Raises
    ------
    NoSuchKeyError
        There is none.
    """
    now = datetime.now(UTC)
    with opened_keys(settings) as keys:
        found = [key for key in keys.find(MOST_LISTED, 0)[0] if name_or_id == key.id]
        found += [key for key in keys.find(MOST_LISTED, 0)[0] if name_or_id == key.name and key.valid(now)]
        if not found:
            raise NoSuchKeyError(name_or_id)
        key = revoke_key(found[0].id, keys, now)
    console.print(f"key {key.id} '{key.name}' is revoked; running services take it no more within 3 s", markup=False)


def show_keys(settings: Settings, console: Console) -> None:
    """Print a table of all keys."""
    with opened_keys(settings) as keys:
        found, _ = keys.find(MOST_LISTED, 0)
    text = _table(found, datetime.now(UTC)) if found else "there are no keys; `tieline keys create` makes one"
    console.print(text, markup=False, highlight=False, soft_wrap=True)


def _table(keys: Sequence[Key], now: datetime) -> str:
    rows = [("id", "name", "project", "scopes", "created", "last used", "state")]
    for key in keys:
        state = "revoked" if key.revoked else "valid" if key.valid(now) else "expired"
        if state == "valid" and key.expires:
            state = f"valid until {key.expires:%Y-%m-%d}"
        used = f"{key.last_used:%Y-%m-%d %H:%M}" if key.last_used else "never"
        scopes = ",".join(sorted(key.scopes))
        rows.append((key.id, key.name, shown_project(key.project), scopes, f"{key.created:%Y-%m-%d}", used, state))
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) for row in rows]
    return "\n".join(line.rstrip() for line in lines)


def _moment(text: str, now: datetime) -> datetime:
    """Read ``90d`` or a date, with or without a time; without a zone it is UTC."""
    days = DAYS.fullmatch(text)
    try:
        moment = now + timedelta(days=int(days[1])) if days else datetime.fromisoformat(text)
    except (ValueError, OverflowError):
        detail = f"'{text}' is no time; write a date such as 2030-12-31, or a number of days such as 90d"
        raise InvalidRequestError(detail, [FieldFault("/expires", detail)]) from None
    return moment if moment.tzinfo else moment.replace(tzinfo=UTC)
