"""Post to receivers on the public internet: to the address that was checked, with limits, and deaf to what they say."""

import asyncio
from collections.abc import Mapping

import httpx

from service.adapters.outgoing.address_check import PORTS, parsed_address
from service.adapters.outgoing.pinned_http import checked_destinations, pinned_request
from service.errors import AddressRefusedError
from service.ports import CallbackBody
from service.settings import Settings

CONNECT_WITHIN_S = 10.0
LEAST_BYTES_PER_S = 100_000
"""A receiver that reads slower is taken for one that does not answer."""


class HttpCallbacks:
    """Reach receivers by HTTP.

    Parameters
    ----------
    settings
        With ports and addresses that are allowed, and the time that a receiver has.
    """

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._ports = {int(port) for port in settings.callback_ports.split(",") if port.strip()}

    async def check(self, uri: str) -> None:
        """Refuse an address to which nothing may be sent.

        Raises
        ------
        AddressRefusedError
            With the reason.
        """
        await checked_destinations(self._allowed(uri), allow_private=self._settings.allow_private_callbacks)

    async def send(self, uri: str, headers: Mapping[str, str], body: CallbackBody) -> int:
        """Post to an address; give the status of the answer, whatever it is. Nothing else of it is read.

        Raises
        ------
        AddressRefusedError
            Nothing may be sent there, or it was not reached, or did not answer in time.
        """
        url = self._allowed(uri)
        within_s = self._settings.callback_timeout_s + body.size / LEAST_BYTES_PER_S
        try:
            async with (
                asyncio.timeout(within_s),
                pinned_request(
                    "POST",
                    url,
                    allow_private=self._settings.allow_private_callbacks,
                    timeouts=httpx.Timeout(self._settings.callback_timeout_s, connect=CONNECT_WITHIN_S),
                    headers={"Content-Type": "application/json", "Content-Length": str(body.size), **headers},
                    content=body.pieces(),
                ) as answer,
            ):
                return answer.status_code
        except TimeoutError:
            raise AddressRefusedError(uri, f"its server did not answer within {within_s:.0f} s") from None
        except (httpx.HTTPError, OSError) as error:
            raise AddressRefusedError(uri, f"it was not reached: {str(error) or type(error).__name__}") from None

    def _allowed(self, uri: str) -> httpx.URL:
        url = parsed_address(uri)
        if self._ports and (url.port or PORTS[url.scheme]) not in self._ports:
            listed = ", ".join(map(str, sorted(self._ports)))
            raise AddressRefusedError(uri, f"the operator of this service allows callbacks to the ports {listed} only")
        return url
