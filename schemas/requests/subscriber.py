"""Whom a job tells how it goes: callbacks of OGC API - Processes 1.0."""

from typing import Annotated

from pydantic import Field

from schemas.requests.callback_secret import CallbackSecret
from schemas.values.base import RequestModel

CallbackUri = Annotated[str, Field(min_length=1, max_length=2000, json_schema_extra={"format": "uri"})]


class Subscriber(RequestModel):
    """Addresses to which the service posts what becomes of a job that runs in the background.

    Each must be `https://` or `http://` and lie on the public internet, unless the operator allows others. A post that
    is not answered with 2xx is repeated, later and later; redirects are not followed.
    """

    success_uri: CallbackUri | None = Field(default=None, alias="successUri")
    """Is sent the result document of a job that succeeds."""
    in_progress_uri: CallbackUri | None = Field(default=None, alias="inProgressUri")
    """Is sent the status of the job from time to time while it runs."""
    failed_uri: CallbackUri | None = Field(default=None, alias="failedUri")
    """Is sent the status of a job that fails or is dismissed."""
    secret: CallbackSecret | None = None
    """Signs what is sent, as Standard Webhooks say (HMAC-SHA256 in the header `webhook-signature`): `whsec_` and a key
    of 16 bytes or more in base64, or any text of 16 characters or more. Left out: the operator's secret, if there is
    one. It is in no answer of the service."""
