"""Which requests need no key, and which scope the others need: the one table of it."""

from service.ports import Scope

SAFE = frozenset({"GET", "HEAD", "OPTIONS"})
PUBLIC = frozenset(
    {
        "/",
        "/conformance",
        "/docs",
        "/healthz",
        "/login",
        "/openapi-3.0.json",
        "/openapi.json",
        "/processes",
        "/readyz",
        "/redoc",
    }
)
"""What describes the service and tells how it is; it says nothing of anybody's files and jobs."""
PUBLIC_BELOW = ("/processes/", "/static/")
SESSIONS = frozenset({"/login", "/logout"})
"""Where a browser's session begins and ends: by what a page of this service sends, and without a key."""
KEYS_ONLY = ("/keys", "/audit")
"""Nobody sees or changes these as long as everybody may come in without a key."""


def is_public(method: str, path: str) -> bool:
    """Tell whether a request needs no key."""
    if method == "OPTIONS" or (method == "POST" and path in SESSIONS):
        return True
    return method in SAFE and (path in PUBLIC or path.startswith(PUBLIC_BELOW))


def needs_keys_in_use(path: str) -> bool:
    """Tell whether a request is refused as long as no key is needed for anything."""
    return _is_at_or_below(path, *KEYS_ONLY)


def scopes_for(method: str, path: str) -> tuple[Scope, ...]:
    """Give the scopes of which a request needs one."""
    if needs_keys_in_use(path):
        return (Scope.ADMIN,)
    if path == "/metrics":
        return (Scope.METRICS, Scope.ADMIN)
    if method not in SAFE:
        return (Scope.WRITE,)
    if _is_at_or_below(path, "/uploads"):
        return (Scope.READ, Scope.WRITE)  # who uploads must be able to ask where to continue
    return (Scope.READ,)


def _is_at_or_below(path: str, *places: str) -> bool:
    return any(path == place or path.startswith(f"{place}/") for place in places)
