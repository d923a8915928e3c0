"""Which requests are answered while no key is needed: those that this machine's user meant to send.

Whoever reaches a service without keys may do everything. So nothing is believed that a stranger could arrange: a name
of his own for this machine (DNS rebinding), a page that lets a browser post here, a proxy that nobody has spoken of.
Whatever a browser sends along by itself, such as a cookie, proves no more than the absence of a key and has to come
under the same rule.
"""

import ipaddress
import re
from dataclasses import dataclass
from urllib.parse import urlsplit

from starlette.datastructures import Headers
from starlette.types import Scope

from service.refusals import ForeignRequestError
from service.routes.access_rules import SAFE
from service.settings import Settings

AUTHORITY = re.compile(r"(?P<host>\[[0-9a-fA-F:.]{2,45}\]|[A-Za-z0-9._-]{1,253})(?::(?P<port>\d{1,5}))?")
FORWARDED = ("forwarded", "via", "x-real-ip")
FORWARDED_BEGINNING = "x-forwarded-"
USUAL_PORTS = {"http": 80, "https": 443}
OF_ONE_ORIGIN = frozenset({"same-origin", "none"})
HERE = "localhost"
FROM_A_HEADER = 0
"""Port of a client whose address a stated proxy has told (as the web server writes it)."""


@dataclass(frozen=True)
class _Place:
    """A host as a client writes it, in one way of writing."""

    host: str
    port: int | None

    @property
    def is_loopback(self) -> bool:
        address = _address(self.host)
        return self.host == HERE if address is None else address.is_loopback


class TrustedRequests:
    """Tell requests of this machine's user from those that somebody else arranged.

    Parameters
    ----------
    settings
        With the address to which the service is bound, and the one by which clients know it.
    """

    def __init__(self, settings: Settings) -> None:
        self._bound = _normal(settings.host)
        self._public = urlsplit(settings.public_url) if settings.public_url else None
        self._off = settings.auth == "off"

    def require(self, scope: Scope) -> None:
        """Refuse a request that nobody at this machine has meant to send.

        Raises
        ------
        ForeignRequestError
            With the reason, and what to do about it.
        """
        headers = Headers(scope=scope)
        self._require_no_proxy(scope, headers)
        place = self._require_known_host(scope, headers)
        if scope["method"] not in SAFE:
            self._require_own_page(scope, headers, place)

    def is_of_own_page(self, scope: Scope) -> bool:
        """Tell whether a browser says that a page of this service sent a request; silence is no such word."""
        headers = Headers(scope=scope)
        site = headers.get("sec-fetch-site")
        if site is not None:  # no page can write it, and it knows what a proxy has changed of the address
            return site.strip().lower() == "same-origin"
        place, origin = _place(headers.get("host", "")), headers.getlist("origin")
        return place is not None and len(origin) == 1 and self._is_own(origin[0], scope, place)

    def _require_no_proxy(self, scope: Scope, headers: Headers) -> None:
        told = [name for name in headers if name in FORWARDED or name.startswith(FORWARDED_BEGINNING)]
        if not told:
            return
        host, port = scope.get("client") or ("", None)
        address = _address(_normal(host))
        stated = port == FROM_A_HEADER and address is not None
        if not (stated and (self._off or (address is not None and address.is_loopback))):
            raise ForeignRequestError(
                f"the header {told[0][:100]} says that a proxy passed this on, and behind a proxy anybody may be"
            )

    def _require_known_host(self, scope: Scope, headers: Headers) -> _Place:
        # where the connection came in: what is written in no header, so nobody can arrange it by a name of his own
        reached = _normal((scope.get("server") or ("", None))[0])
        given = headers.getlist("host")
        if not given:  # no browser leaves it out, and HTTP/1.1 is not spoken without
            return _Place(reached, None)
        place = _place(given[0]) if len(given) == 1 else None
        if place is None:
            raise ForeignRequestError("the header Host does not say for whom this request is")
        public = None if self._public is None else _normal(self._public.hostname or "")
        if not (place.is_loopback or place.host in {self._bound, reached, public}):
            raise ForeignRequestError(
                f"the header Host names {place.host[:100]}, which is not this machine (TIELINE_PUBLIC_URL says under "
                "which name a service is known)"
            )
        return place

    def _require_own_page(self, scope: Scope, headers: Headers, place: _Place) -> None:
        site = headers.get("sec-fetch-site")
        if site is not None and site.strip().lower() not in OF_ONE_ORIGIN:
            raise ForeignRequestError(f"a page of another origin sent it (Sec-Fetch-Site: {site[:40]})")
        for origin in headers.getlist("origin"):
            if not self._is_own(origin, scope, place):
                raise ForeignRequestError(f"a page of another origin sent it (Origin: {origin[:100]})")

    def _is_own(self, origin: str, scope: Scope, place: _Place) -> bool:
        found = _origin(origin)
        own = [(scope["scheme"], place.host, place.port or USUAL_PORTS.get(scope["scheme"]))]
        if self._public is not None:
            own.append(_origin(f"{self._public.scheme}://{self._public.netloc}") or own[0])
        return found is not None and found in own


def _origin(text: str) -> tuple[str, str, int | None] | None:
    scheme, separator, authority = text.strip().partition("://")
    place = _place(authority)
    if not separator or place is None:
        return None  # also `null`, of a page in a sandbox or a file
    scheme = scheme.lower()
    return scheme, place.host, place.port or USUAL_PORTS.get(scheme)


def _place(authority: str) -> _Place | None:
    found = AUTHORITY.fullmatch(authority.strip())
    if found is None:
        return None
    return _Place(_normal(found["host"]), None if found["port"] is None else int(found["port"]))


def _normal(host: str) -> str:
    """Write a host in one way: without brackets, capitals and the dot at the end, addresses as short as they go."""
    bare = host.strip().removeprefix("[").removesuffix("]").lower().removesuffix(".")
    address = _address(bare)
    return bare if address is None else str(address)


def _address(host: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    try:
        address = ipaddress.ip_address(host)
    except ValueError:
        return None
    return getattr(address, "ipv4_mapped", None) or address
