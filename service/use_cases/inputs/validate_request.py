"""Read JSON bodies and say which of their fields are wrong, by JSON pointer."""

import json
import math
from collections.abc import Sequence
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails, from_json

from service.errors import FieldFault, InvalidRequestError

MOST_MEMBERS = 130_000
"""Of one array or object; the longest that there is use for are all pairs of 500 stations."""
MOST_CONTAINERS, MOST_SEPARATORS = 200_000, 1_200_000
"""Arrays and objects, commas and colons of a whole document: 500 stations with ten photos each, and all their pairs;
a network of 90 000 image points."""
DEEPEST = 32
"""Arrays and objects within each other."""
TOO_DEEP = f"arrays and objects are nested more than {DEEPEST} deep"
BEYOND = "this is no valid JSON: a number is beyond what float64 can hold"
MOST_FAULTS = 1000
"""More are counted and not listed: each takes a hundred times the room of what is wrong."""
ModelT = TypeVar("ModelT", bound=BaseModel)
WRONG_FIELDS = "some fields of the request are wrong; each is listed with its JSON pointer"


def parse_json(body: bytes, pointer: str = "") -> Any:
    """Parse a JSON body. What it would take is counted first: a list of nothing takes fifty bytes for each of its own.

    Raises
    ------
    InvalidRequestError
        It is empty or no JSON, it holds NaN or a number beyond float64, with line and column; or lists without end, one
        in the other or one after the other.
    """
    if (what := _too_much(body)) is not None:
        raise InvalidRequestError(what, [FieldFault(pointer, what)])
    try:
        document = from_json(body, allow_inf_nan=False, cache_strings="keys")
    except ValueError as error:
        what = "the body is empty; a JSON object is expected" if not body.strip() else f"this is no valid JSON: {error}"
        raise InvalidRequestError(what, [FieldFault(pointer, what)]) from None
    if (what := _unusable(document)) is not None:
        place = pointer_to(*_deepest(document)) if what == TOO_DEEP else ""
        raise InvalidRequestError(what, [FieldFault(pointer + place, what)])
    return document


def _too_much(body: bytes) -> str | None:
    """Say why a document takes too much to be read, by what separates its values; what stands in texts counts too."""
    containers = body.count(b"[") + body.count(b"{")
    if containers > MOST_CONTAINERS:
        return f"the document has {containers} arrays and objects, at most {MOST_CONTAINERS} are read"
    separators = body.count(b",") + body.count(b":")
    if separators > MOST_SEPARATORS:
        return f"the document has {separators} commas and colons, at most {MOST_SEPARATORS} are read"
    return None


def _unusable(document: Any) -> str | None:
    """Say why a parsed document cannot be used: too deep, too long in one place, or a number that is none."""
    level = [document] if _has_members(document) else []
    if isinstance(document, float) and math.isinf(document):
        return BEYOND
    for _ in range(DEEPEST):
        below: list[Any] = []
        for members in level:
            if len(members) > MOST_MEMBERS:
                return f"an array or object has {len(members)} members, at most {MOST_MEMBERS} are read"
            for value in members.values() if isinstance(members, dict) else members:
                if isinstance(value, list | dict):
                    below.append(value)
                elif isinstance(value, float) and math.isinf(value):
                    return BEYOND
        if not below:
            return None
        level = below
    return TOO_DEEP


def _deepest(document: Any) -> Sequence[str | int]:
    """Give the way to the first value that lies too deep."""
    left: list[tuple[Any, tuple[str | int, ...]]] = [(document, ())]
    while left:
        members, way = left.pop()
        if len(way) >= DEEPEST:
            return way
        named = members.items() if isinstance(members, dict) else enumerate(members)
        left += [(value, (*way, name)) for name, value in named if _has_members(value)]
    return ()


def validated(model: type[ModelT], document: Any, root: str = "") -> ModelT:
    """Validate a parsed document strictly (no text for numbers).

    Parameters
    ----------
    model
        What the document must be.
    document
        Parsed JSON.
    root
        Pointer to the document in the request body.

    Raises
    ------
    InvalidRequestError
        With one fault per bad field.
    """
    try:
        return model.model_validate_json(json.dumps(document), strict=True)
    except ValidationError as error:
        if error.error_count() > MOST_FAULTS:
            what = f"{error.error_count()} fields of the request are wrong"
            raise InvalidRequestError(what, [FieldFault(root, what)]) from None
        raise InvalidRequestError(WRONG_FIELDS, _faults(error.errors(include_url=False), document, root)) from None


def pointer_to(*parts: str | int) -> str:
    """Build a JSON pointer (RFC 6901)."""
    return "".join("/" + str(part).replace("~", "~0").replace("/", "~1") for part in parts)


def _has_members(value: Any) -> bool:
    return isinstance(value, list | dict)


def _faults(errors: Sequence[ErrorDetails], document: Any, root: str) -> list[FieldFault]:
    details: dict[str, list[str]] = {}
    for error in errors:
        where = list(_within(error["loc"], document))
        if error["type"] in {"union_tag_invalid", "union_tag_not_found"}:
            where.append(str(error["ctx"]["discriminator"]).strip("'"))
        message = "unknown field" if error["type"] == "extra_forbidden" else error["msg"]
        known = details.setdefault(root + pointer_to(*where), [])
        if message not in known:
            known.append(message)
    return [FieldFault(pointer, " or: ".join(messages)) for pointer, messages in details.items()]


def _within(location: Sequence[str | int], document: Any) -> Sequence[str | int]:
    """Keep of a pydantic location what exists in the document; the names of union members do not."""
    where: list[str | int] = []
    current = document
    for number, part in enumerate(location):
        last = number == len(location) - 1
        if isinstance(current, dict) and isinstance(part, str) and (part in current or last):
            current = current.get(part)
        elif isinstance(current, list) and isinstance(part, int) and (part < len(current) or last):
            current = current[part] if part < len(current) else None
        else:
            continue
        where.append(part)
    return where
