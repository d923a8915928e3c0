"""Keys: make, list, revoke; with the scope admin only."""

import asyncio
from datetime import UTC, datetime
from typing import Any

from fastapi import Request, Response
from fastapi.responses import JSONResponse

from schemas.resources.keys import KeyDocument, KeyList, KeyRequest, NewKeyDocument
from schemas.values.links import Link
from service.dependencies import AccessStoresDependency, BaseUrl, BaseUrlDependency, IdentifiersDependency
from service.names.identifiers import is_identifier
from service.ports import Key
from service.refusals import NoSuchKeyError
from service.routes.documents import page_links
from service.routes.paging import LimitParameter, OffsetParameter, page_size
from service.routes.problems import PROBLEM_RESPONSES
from service.routes.readable_router import ReadableRouter
from service.routes.request_bodies import read_json
from service.use_cases.access.manage_keys import create_key, revoke_key, shown_project
from service.use_cases.inputs.validate_request import validated

router = ReadableRouter(tags=["keys"], responses=PROBLEM_RESPONSES)
KEY_BODY = {
    "requestBody": {"required": True, "content": {"application/json": {"schema": KeyRequest.model_json_schema()}}}
}


@router.post("/keys", status_code=201, summary="Make a key", response_model=NewKeyDocument, openapi_extra=KEY_BODY)
async def make_key(
    request: Request, stores: AccessStoresDependency, url: BaseUrlDependency, _make_id: IdentifiersDependency
) -> Response:
    """Make a key. Its secret is in this answer and nowhere else; nobody can find it out again."""
    wanted = validated(KeyRequest, await read_json(request))
    now = datetime.now(UTC)
    key, secret = await asyncio.to_thread(
        create_key, wanted.name, wanted.project, wanted.scopes, wanted.expires, stores.keys, now
    )
    document = NewKeyDocument(**_members(key, url), key=secret)
    request.state.body_to_keep = document.model_copy(update={"key": None}).model_dump_json(by_alias=True).encode()
    content = document.model_dump(mode="json", by_alias=True)
    headers = {"Location": url(f"/keys/{key.id}"), "Cache-Control": "no-store"}
    return JSONResponse(content, status_code=201, headers=headers)


@router.get("/keys", summary="List keys, newest first")
def list_keys(
    stores: AccessStoresDependency, url: BaseUrlDependency, limit: LimitParameter = 100, offset: OffsetParameter = 0
) -> KeyList:
    """List the keys of all projects, also those that are revoked, newest first, page by page."""
    limit = page_size(limit)
    found, total = stores.keys.find(limit, offset)
    return KeyList(
        keys=[_document(key, url) for key in found],
        number_matched=total,
        number_returned=len(found),
        links=page_links(url, "/keys", {}, limit, offset, total),
    )


@router.get("/keys/{key_id}", summary="What a key is good for")
def get_key(key_id: str, stores: AccessStoresDependency, url: BaseUrlDependency) -> KeyDocument:
    """Describe a key without its secret."""
    stored = stores.keys.get(key_id) if is_identifier(key_id) else None
    if stored is None:
        raise NoSuchKeyError(key_id)
    return _document(stored.key, url)


@router.delete("/keys/{key_id}", summary="Revoke a key")
async def delete_key(
    key_id: str, request: Request, stores: AccessStoresDependency, url: BaseUrlDependency
) -> KeyDocument:
    """Revoke a key for good: at once in the process that answers, within 3 s in all others."""
    if not is_identifier(key_id):
        raise NoSuchKeyError(key_id)
    key = await asyncio.to_thread(revoke_key, key_id, stores.keys, datetime.now(UTC))
    request.app.state.gatekeeper.forget(key_id)
    return _document(key, url)


def _document(key: Key, url: BaseUrl) -> KeyDocument:
    return KeyDocument(**_members(key, url))


def _members(key: Key, url: BaseUrl) -> dict[str, Any]:
    return {
        "id": key.id,
        "name": key.name,
        "project": shown_project(key.project),
        "scopes": [scope.value for scope in sorted(key.scopes)],
        "created": key.created,
        "expires": key.expires,
        "revoked": key.revoked,
        "last_used": key.last_used,
        "links": [Link(href=url(f"/keys/{key.id}"), rel="self", title="This key")],
    }
