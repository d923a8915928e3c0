"""How a request names a file: by the identifier that it got when it was uploaded, or by its address elsewhere."""

from typing import Any

from pydantic import ConfigDict, Field

from schemas.values.base import RequestModel


def by_file_or_address(schema: dict[str, Any]) -> None:
    """Describe both ways; the service puts an identifier in the place of an address before it validates a request.

    That one of them must be there is said in words: of `anyOf` beside properties generators of clients make no class.
    """
    schema["required"].remove("file")
    if not schema["required"]:
        del schema["required"]
    schema["properties"]["href"] = {
        "type": "string",
        "format": "uri",
        "maxLength": 2000,
        "title": "Href",
        "description": "In place of `file` (one of both must be there): where the job fetches it, `https://…` or "
        "`s3://bucket/key`, if the operator allows that source. The file is stored like one that was uploaded.",
    }


class FileReference(RequestModel):
    """A file that was uploaded, or that the job fetches."""

    model_config = ConfigDict(json_schema_extra=by_file_or_address)

    file: str = Field(min_length=1, max_length=64)
    """Identifier of the file, as `POST /files` gave it."""
