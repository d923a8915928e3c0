"""HEAD wherever there is GET (RFC 9110, 9.1)."""

from collections.abc import Callable
from typing import Any

from fastapi import APIRouter


class ReadableRouter(APIRouter):
    """Answer HEAD by what answers GET, without describing it: responses know what to leave out."""

    def add_api_route(self, path: str, endpoint: Callable[..., Any], **options: Any) -> None:
        """Add a route, and its twin for HEAD if it answers GET."""
        super().add_api_route(path, endpoint, **options)
        if options.get("methods") == ["GET"]:
            options |= {"methods": ["HEAD"], "include_in_schema": False}
            super().add_api_route(path, endpoint, **options)
