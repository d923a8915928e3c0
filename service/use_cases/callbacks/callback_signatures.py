"""Signatures of callbacks, as the specification of Standard Webhooks 1.0 describes them (scheme `v1`, symmetric).

Signed is ``<id>.<timestamp>.<body>`` with HMAC-SHA256; receivers find libraries for it in most languages.
"""

import base64
import hashlib
import hmac
from collections.abc import Iterable, Mapping
from urllib.parse import urlsplit

from schemas.requests.callback_secret import signing_key

USUAL_PORTS = {"http": 80, "https": 443}
DEFAULT_PROJECT = "default"
UNSIGNED = frozenset({"echo"})
"""Processes whose results are what the request says: the operator's secret is no word of his for them."""


def derived_secret(secret: str, project: str, uri: str, process_id: str) -> str:
    """Give the secret that signs for one project, one receiver and one process.

    Whoever may run jobs decides what is in them, and to whom they are told. So the operator's secret signs nothing
    itself: what a receiver accepts comes from the project that it trusts, was meant for it, and is of the process that
    it expects.

    Parameters
    ----------
    secret
        Of the operator.
    project
        Whose job it is.
    uri
        Address of the receiver, of which scheme, host and port count.
    process_id
        Of the job.
    """
    parts = urlsplit(uri)
    port = parts.port or USUAL_PORTS.get(parts.scheme, 0)
    receiver = f"{parts.scheme}://{(parts.hostname or '').rstrip('.')}:{port}"
    named = "\n".join(("tieline callback", project or DEFAULT_PROJECT, receiver, process_id))
    key = hmac.digest(signing_key(secret), named.encode(), hashlib.sha256)
    return f"whsec_{base64.b64encode(key).decode()}"


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
