"""Make and revoke keys."""

import re
from collections.abc import Collection
from datetime import datetime

from service.errors import FieldFault, InvalidRequestError
from service.ports import Key, KeyStore, Scope, StoredKey
from service.refusals import KeyNameTakenError, NoSuchKeyError
from service.use_cases.access.key_secrets import hashed, new_key_id, new_token
from service.use_cases.inputs.validate_request import WRONG_FIELDS, pointer_to

NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}")
DEFAULT_PROJECT = "default"
"""What people call the project of all that was made without keys."""
USUAL_SCOPES = frozenset({Scope.READ, Scope.WRITE})


def owner_of(project: str) -> str:
    """Give the owner under which the things of a project are kept."""
    return "" if project == DEFAULT_PROJECT else project


def shown_project(owner: str) -> str:
    """Give what people call the project of an owner."""
    return owner or DEFAULT_PROJECT


def create_key(
    name: str,
    project: str | None,
    scopes: Collection[str],
    expires: datetime | None,
    keys: KeyStore,
    now: datetime,
) -> tuple[Key, str]:
    """Make a key; give it and its secret, which is nowhere kept.

    Parameters
    ----------
    name
        Of the key, for people.
    project
        Whose files and jobs it sees; None: one of the key's own name; ``default``: that of all that was made without
        keys.
    scopes
        What it is good for.
    expires
        When it ends by itself.
    keys
        Where keys are kept.
    now
        Time of the request.

    Raises
    ------
    InvalidRequestError
        A field is wrong.
    KeyNameTakenError
        A key of this name is valid.
    """
    _check(name, project, scopes, expires, now)
    owner = owner_of(name if project is None else project)
    key = Key(new_key_id(), name, owner, frozenset(Scope(scope) for scope in scopes), now, expires)
    token = new_token(key.id)
    if not keys.add(StoredKey(key, hashed(token))):
        raise KeyNameTakenError(name)
    return key, token


def revoke_key(key_id: str, keys: KeyStore, now: datetime) -> Key:
    """Revoke a key for good.

    Raises
    ------
    NoSuchKeyError
        There is none.
    """
    key = keys.revoke(key_id, now)
    if key is None:
        raise NoSuchKeyError(key_id)
    return key


def _check(name: str, project: str | None, scopes: Collection[str], expires: datetime | None, now: datetime) -> None:
    faults = []
    text = "it has 1 to 64 letters, digits, points, dashes and underscores, and begins with a letter or digit"
    if NAME.fullmatch(name) is None:
        faults.append(FieldFault(pointer_to("name"), text))
    if project is not None and NAME.fullmatch(project) is None:
        faults.append(FieldFault(pointer_to("project"), text))
    known = [scope.value for scope in Scope]
    if not scopes or not set(scopes) <= set(known):
        faults.append(FieldFault(pointer_to("scopes"), f"one or more of {', '.join(known)}"))
    if expires is not None and (expires.tzinfo is None or expires <= now):
        faults.append(FieldFault(pointer_to("expires"), "a time to come, with its zone"))
    if faults:
        raise InvalidRequestError(WRONG_FIELDS, faults)
