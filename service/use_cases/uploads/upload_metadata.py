"""What a client says of a resumable upload: keys and values in base64, as tus has them."""

import base64
import binascii


def metadata_values(text: str) -> dict[str, str]:
    """Give the values by their keys.

    Raises
    ------
    ValueError
        A value is no text in base64.
    """
    values: dict[str, str] = {}
    for pair in text.split(",") if text.strip() else ():
        key, _, value = pair.strip().partition(" ")
        try:
            values[key] = base64.b64decode(value.strip(), validate=True).decode()
        except (binascii.Error, ValueError):
            raise ValueError(f"the value of '{key}' is no UTF-8 text in base64") from None
    return values
