"""Damage done to JSON requests, from a generator with a fixed seed."""

import json
from collections.abc import Callable, Sequence
from copy import deepcopy
from typing import Any

import numpy as np

ABSURD: Sequence[Any] = (
    None, True, False, "", "x", "NaN", "\u0000", "\u202e" * 50, "x" * 5000, "../../etc/passwd", "auto",
    0, -1, 1, 2**31, 2**63, -(2**63) - 1, 10**400, 0.5, -0.0, 5e-324, 1e-300, 1e9, -1e9, 1e300, -1.7e308,
    [], {}, [[]], [None] * 50, [[1.0] * 4] * 4, [[0.0] * 4] * 4, [[0.0] * 3] * 3, {"": {}}, {"file": None},
    {"href": "file:///etc/passwd"}, {"$ref": "#"},
)  # fmt: skip
Place = tuple[str | int, ...]
Mutation = Callable[[Any, str | int, np.random.Generator], None]


def _replace(parent: Any, key: str | int, rng: np.random.Generator) -> None:
    parent[key] = deepcopy(ABSURD[int(rng.integers(len(ABSURD)))])


def _rescale(parent: Any, key: str | int, rng: np.random.Generator) -> None:
    if isinstance(parent[key], int | float):
        factor = 10.0 ** rng.uniform(-7.0, 7.0) * rng.choice([-1.0, 1.0])
        parent[key] = type(parent[key])(float(parent[key] or 1.0) * factor)


def _disturb(parent: Any, key: str | int, rng: np.random.Generator) -> None:
    if isinstance(parent[key], float):
        parent[key] += float(rng.normal(0.0, 10.0 ** rng.uniform(-9.0, 1.0)))


def _remove(parent: Any, key: str | int, _rng: np.random.Generator) -> None:
    del parent[key]


def _repeat(parent: Any, key: str | int, rng: np.random.Generator) -> None:
    if isinstance(parent, list):
        parent.extend(deepcopy(parent[key]) for _ in range(int(rng.integers(1, 300))))
    else:
        parent[f"{key}{chr(int(rng.integers(32, 0x2FF)))}"] = deepcopy(parent[key])


def _nest(parent: Any, key: str | int, rng: np.random.Generator) -> None:
    for _ in range(int(rng.integers(1, 60))):
        parent[key] = [parent[key]] if rng.random() < 0.5 else {"file": parent[key]}


def _as_text(parent: Any, key: str | int, _rng: np.random.Generator) -> None:
    parent[key] = json.dumps(parent[key])


MUTATIONS: Sequence[Mutation] = (_replace, _replace, _rescale, _rescale, _disturb, _remove, _repeat, _nest, _as_text)
GENTLE: Sequence[Mutation] = (_rescale, _disturb, _disturb)


def places_of(document: Any, below: Place = ()) -> list[Place]:
    """List where every value of a document stands."""
    members = document.items() if isinstance(document, dict) else enumerate(document)
    found: list[Place] = []
    for key, value in members:
        found.append((*below, key))
        if isinstance(value, dict | list):
            found += places_of(value, (*below, key))
    return found


def damaged_request(document: Any, number: int, mutations: Sequence[Mutation] = MUTATIONS) -> Any:
    """Give a copy with one to three things changed; each number gives the same one again."""
    rng = np.random.default_rng(number)
    changed = deepcopy(document)
    for _ in range(int(rng.integers(1, 4))):
        places = places_of(changed)
        if not places:
            break
        *above, key = places[int(rng.integers(len(places)))]
        parent = changed
        for step in above:
            parent = parent[step]
        mutations[int(rng.integers(len(mutations)))](parent, key, rng)
    return changed
