"""Secrets that sign callbacks, as the specification of Standard Webhooks 1.0 writes them."""

import base64
import binascii
from typing import Annotated

from pydantic import AfterValidator, Field
from pydantic_core import PydanticCustomError

PREFIX = "whsec_"
LEAST_KEY_BYTES = 16


def signing_key(secret: str) -> bytes:
    """Give the key that a secret stands for: after ``whsec_`` base64, otherwise the text itself.

    Raises
    ------
    PydanticCustomError
        It is no base64, or too short.
    """
    key = secret.encode()
    if secret.startswith(PREFIX):
        try:
            key = base64.b64decode(secret.removeprefix(PREFIX), validate=True)
        except binascii.Error:
            raise PydanticCustomError("callback_secret", "after whsec_ a key in base64 is expected") from None
    if len(key) < LEAST_KEY_BYTES:
        raise PydanticCustomError("callback_secret", "a key of less than 16 bytes can be guessed")
    return key


def _checked(secret: str) -> str:
    signing_key(secret)
    return secret


CallbackSecret = Annotated[str, Field(max_length=200, pattern=r"^[ -~]*$"), AfterValidator(_checked)]
"""`whsec_` and a key of 16 bytes or more in base64, or any text of 16 letters of ASCII or more."""
