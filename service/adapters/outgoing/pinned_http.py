"""Requests to servers that a stranger has named: to the address that was checked, and nowhere else.

The host is resolved once, every address found is checked, and the connection made to one of those: a name that points
elsewhere a moment later leads nowhere. Redirects are not followed, proxies of the environment not used.
"""

import asyncio
import socket
import ssl
from collections.abc import AsyncIterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AsyncExitStack, asynccontextmanager
from functools import cache, partial

import httpx

from service.adapters.outgoing.address_check import PORTS, is_of_the_host, is_public
from service.errors import AddressRefusedError

RESOLVE_WITHIN_S = 10.0
MOST_RESOLVED_AT_ONCE = 8
NOT_PUBLIC = "its host has no address on the public internet"
NOT_REACHED = "its host has no address that may be reached from here"
MOST_ADDRESSES = 3
"""That are tried, one after the other."""


@asynccontextmanager
async def pinned_request(
    method: str,
    url: httpx.URL,
    *,
    allow_private: bool,
    timeouts: httpx.Timeout,
    headers: Mapping[str, str],
    content: AsyncIterator[bytes] | None = None,
) -> AsyncIterator[httpx.Response]:
    """Send a request and give the answer, its body not read yet.

    Parameters
    ----------
    method, url, headers, content
        Of the request; the address as `service.adapters.outgoing.address_check.parsed_address` gives it.
    allow_private
        Connect to addresses inside the network too.
    timeouts
        For connecting, and between two pieces of data.

    Raises
    ------
    AddressRefusedError
        The host has no address, or one that is not public.
    httpx.HTTPError
        Its server does not answer as HTTP asks.
    """
    addresses = await checked_destinations(url, allow_private=allow_private)
    host = url.raw_host.decode("ascii")
    async with AsyncExitStack() as stack:
        client = await stack.enter_async_context(
            httpx.AsyncClient(trust_env=False, follow_redirects=False, timeout=timeouts, verify=_certificates())
        )
        for left, address in enumerate(addresses, start=1 - len(addresses)):
            request = client.stream(
                method,
                url.copy_with(host=address, port=url.port or PORTS[url.scheme]),
                headers={"Host": url.netloc.decode("ascii"), "User-Agent": "tieline", **headers},
                content=content,
                extensions={"sni_hostname": host.rstrip(".")},
            )
            try:
                answer = await stack.enter_async_context(request)
                break
            except (httpx.ConnectError, httpx.ConnectTimeout):
                # nothing was sent yet; a name may have an address of IPv6 that is out of reach from here
                if not left:
                    raise
        yield answer


async def checked_destinations(url: httpx.URL, *, allow_private: bool) -> Sequence[str]:
    """Resolve the host of an address, check all that was found, and give the addresses to connect to, the best first.

    Raises
    ------
    AddressRefusedError
        The host has no address that may be reached: no public one, unless others are allowed, or one of the machine's
        own services in a cloud. Which of these is not said, for a stranger could learn the names in this network.
    """
    host, port = url.raw_host.decode("ascii"), url.port or PORTS[url.scheme]
    ask = partial(socket.getaddrinfo, host, port, type=socket.SOCK_STREAM)
    try:
        async with asyncio.timeout(RESOLVE_WITHIN_S):
            found = await asyncio.get_running_loop().run_in_executor(_resolvers(), ask)
    except TimeoutError:
        raise AddressRefusedError(str(url), f"its host was not found within {RESOLVE_WITHIN_S:g} s") from None
    except (OSError, UnicodeError):
        found = []
    named = dict.fromkeys(str(each[4][0]) for each in found)
    addresses = [address for address in named if not is_of_the_host(address)]
    if not addresses or not (allow_private or all(map(is_public, named))):
        raise AddressRefusedError(str(url), NOT_REACHED if allow_private else NOT_PUBLIC)
    return addresses[:MOST_ADDRESSES]


@cache
def _resolvers() -> ThreadPoolExecutor:
    """Give threads for nothing else: names whose servers never answer hold up other names and no other requests."""
    return ThreadPoolExecutor(MOST_RESOLVED_AT_ONCE, thread_name_prefix="resolver")


@cache
def _certificates() -> ssl.SSLContext:
    """Load the authorities that are trusted: those of the library, or of SSL_CERT_FILE or SSL_CERT_DIR."""
    return httpx.create_ssl_context(trust_env=True)
