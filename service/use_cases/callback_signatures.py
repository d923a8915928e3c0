"""Signatures of callbacks, as the specification of Standard Webhooks 1.0 describes them (scheme `v1`, symmetric).

Signed is ``<id>.<timestamp>.<body>`` with HMAC-SHA256; receivers find libraries for it in most languages.
"""

import base64
import hashlib
import hmac
from collections.abc import Iterable, Mapping

from schemas.callback_secret import signing_key


def signed_headers(secret: str, delivery_id: str, timestamp: int, body: Iterable[bytes]) -> Mapping[str, str]:
    """Give the headers of a delivery; without a secret those that need none.

    Parameters
    ----------
    secret
        Empty for none.
    delivery_id
        The same whenever the delivery is repeated.
    timestamp
        Time of sending [s since 1970].
    body
        In pieces, which are read once.
    """
    headers = {"webhook-id": delivery_id, "webhook-timestamp": str(timestamp)}
    if secret:
        signature = hmac.new(signing_key(secret), f"{delivery_id}.{timestamp}.".encode(), hashlib.sha256)
        for piece in body:
            signature.update(piece)
        headers["webhook-signature"] = f"v1,{base64.b64encode(signature.digest()).decode()}"
    return headers
