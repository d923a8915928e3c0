"""What is refused because of who asks, how much, or how often."""

from collections.abc import Mapping

from service.errors import ServiceError

REALM = 'Bearer realm="Tieline"'


class UnauthenticatedError(ServiceError):
    """Say that a key is needed. Why a key is not taken is never told."""

    status, title = 401, "Key needed"

    def __init__(self, *, given: bool) -> None:
        self.given = given
        super().__init__(
            "this key is not valid"
            if given
            else "this service wants a key in the header `Authorization: Bearer …`; its operator makes them with "
            "`tieline keys create`"
        )

    def headers(self) -> Mapping[str, str]:
        """Name the way of authentication (RFC 6750, section 3)."""
        return {"WWW-Authenticate": f'{REALM}, error="invalid_token"' if self.given else REALM}


class ForbiddenError(ServiceError):
    """Say that a key is not good for this."""

    status, title = 403, "Not allowed with this key"

    def __init__(self, scopes: str) -> None:
        self.scopes = scopes
        super().__init__(f"this needs a key with the scope {scopes}")

    def headers(self) -> Mapping[str, str]:
        """Name what is missing (RFC 6750, section 3.1)."""
        return {"WWW-Authenticate": f'{REALM}, error="insufficient_scope", scope="{self.scopes}"'}


class KeysNotInUseError(ServiceError):
    """Say that nobody may do this over HTTP as long as everybody may do all else."""

    status, title = 403, "Not without keys"

    def __init__(self) -> None:
        super().__init__(
            "this service asks for no keys, so that anybody could do this; it needs a key with the scope admin, which "
            "`tieline keys create NAME --scopes admin` makes"
        )


class ForeignRequestError(ServiceError):
    """Say why a request is not taken for one of this machine's user."""

    status, title = 403, "Not from this machine"

    def __init__(self, reason: str) -> None:
        super().__init__(
            f"{reason}; as long as this service needs no keys it answers only who sits at its machine. `tieline keys "
            "create NAME` makes a key, and from then on it answers whoever has one"
        )


class ForeignPageError(ServiceError):
    """Say that a browser's session is good for requests of this service's own pages only."""

    status, title = 403, "Not from a page of this service"

    def __init__(self) -> None:
        super().__init__(
            "a browser sent its session along with a change that no page of this service has asked for; a program "
            "sends its key in the header `Authorization: Bearer …`"
        )


class OpenToAllError(ServiceError):
    """Say that a service would be open to everybody."""

    status, title = 400, "Open to all"

    def __init__(self, host: str) -> None:
        super().__init__(
            f"at {host} others could reach this service, and it has no keys yet. Make one with `tieline keys create "
            "NAME` (same data directory or database), or set TIELINE_AUTH=required and make keys later, or set "
            "TIELINE_AUTH=off if something else keeps strangers out"
        )


class TooOftenError(ServiceError):
    """Say that requests come too fast."""

    status, title = 429, "Too many requests"

    def __init__(self, what: str, limit: int, retry_after_s: int) -> None:
        self.retry_after_s = retry_after_s
        super().__init__(f"{what}: {limit} in a minute are allowed; go on in {retry_after_s} s")

    def headers(self) -> Mapping[str, str]:
        """Tell when to go on."""
        return {"Retry-After": str(self.retry_after_s)}


class BusyError(ServiceError):
    """Say that a request has waited long enough for its turn."""

    status, title = 503, "Busy"

    def __init__(self, what: str, waited_s: float, retry_after_s: int) -> None:
        self.retry_after_s = retry_after_s
        super().__init__(f"{what} has waited {waited_s:.3g} s for its turn; try again later")

    def headers(self) -> Mapping[str, str]:
        """Tell when to try again."""
        return {"Retry-After": str(self.retry_after_s)}


class QuotaFullError(ServiceError):
    """Say that a project has stored as much as it may."""

    status, title = 413, "Quota exceeded"

    def __init__(self, what: str, amount: int, limit: int) -> None:
        super().__init__(
            f"this project would have {amount} {what}, its limit is {limit}; DELETE /files/{{id}} and /jobs/{{id}} "
            "remove what is not needed any more"
        )


class RequestDiffersError(ServiceError):
    """Say that an Idempotency-Key was used for something else."""

    status, title = 409, "Idempotency-Key used before"

    def __init__(self, key: str) -> None:
        super().__init__(
            f"the Idempotency-Key '{key}' was used for another request within the last 24 h; a new request needs a new "
            "key"
        )


class RequestUnderWayError(ServiceError):
    """Say that the first request with an Idempotency-Key has not been answered yet."""

    status, title = 409, "Request under way"

    def __init__(self, key: str, retry_after_s: int) -> None:
        self.retry_after_s = retry_after_s
        super().__init__(f"the first request with the Idempotency-Key '{key}' has not been answered yet; ask again")

    def headers(self) -> Mapping[str, str]:
        """Tell when to ask again."""
        return {"Retry-After": str(self.retry_after_s)}


class NoSuchKeyError(ServiceError):
    """Say that a key does not exist."""

    status, title = 404, "No such key"

    def __init__(self, key_id: str) -> None:
        super().__init__(f"there is no key '{key_id}'; GET /keys or `tieline keys list` lists them")


class KeyNameTakenError(ServiceError):
    """Say that a key of a name exists."""

    status, title = 409, "Name taken"

    def __init__(self, name: str) -> None:
        super().__init__(f"there is a key called '{name}' already; revoke it first, or take another name")
