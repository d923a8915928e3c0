"""The landing page and what the service conforms to."""

import asyncio

from fastapi import Request, Response
from fastapi.responses import HTMLResponse, JSONResponse

from schemas.resources.landing import Conformance, LandingPage
from schemas.values.links import Link
from service.dependencies import BaseUrl, BaseUrlDependency, SettingsDependency, base_path_of
from service.routes import openapi_30
from service.routes.readable_router import ReadableRouter
from service.settings import Settings
from service.use_cases.access.service_proof import CHALLENGE, CHALLENGE_HEADER, PROOF_HEADER, proof_of, secret_of
from service.web.interface_page import interface_html
from service.web.page_rendering import POLICY, documentation_html

OGC = "http://www.opengis.net/def/rel/ogc/1.0/"
CLASS = "http://www.opengis.net/spec/ogcapi-processes-1/1.0/conf/"
TITLE = "Tieline"
DESCRIPTION = (
    "Registers terrestrial laser scans by the straight lines, planes and cylinders of the built world, without a first "
    "guess and with honest standard deviations."
)
CLASSES = ("core", "ogc-process-description", "json", "oas30", "job-list", "dismiss", "callback")
CONFORMANCE = tuple(CLASS + name for name in CLASSES)

router = ReadableRouter(tags=["service"])


@router.get(
    "/",
    summary="Landing page",
    response_model=LandingPage,
    responses={200: {"content": {"text/html": {"schema": {"type": "string"}}}}},
)
async def landing(request: Request, url: BaseUrlDependency, settings: SettingsDependency) -> Response:
    """Link to everything else; a page for browsers."""
    page = _page(url, request.app.version)
    return JSONResponse(page.model_dump(mode="json"), headers=await _proof(request, settings))


async def _proof(request: Request, settings: Settings) -> dict[str, str]:
    """Answer a challenge by which a program of the service's own user wants to know whom it talks to."""
    challenge = request.headers.get(CHALLENGE_HEADER, "")
    if CHALLENGE.fullmatch(challenge) is None:
        return {}
    secret = await asyncio.to_thread(secret_of, settings.data_dir)
    port = (request.scope.get("server") or ("", None))[1]
    return {} if secret is None else {PROOF_HEADER: proof_of(secret, challenge, port)}


@router.get("/docs", include_in_schema=False)
def documentation(request: Request) -> HTMLResponse:
    """Describe the interface for people, who can try it there."""
    return HTMLResponse(documentation_html(TITLE, base_path_of(request)), headers={"Content-Security-Policy": POLICY})


@router.get("/redoc", include_in_schema=False)
def documentation_without_scripts(request: Request) -> HTMLResponse:
    """Describe the interface for people in a page without scripts."""
    return HTMLResponse(interface_html(request.app.openapi()))


@router.get("/conformance", summary="Conformance classes")
async def conformance() -> Conformance:
    """List the conformance classes of OGC API - Processes 1.0 that the service declares."""
    return Conformance(conforms_to=list(CONFORMANCE))


def _page(url: BaseUrl, version: str) -> LandingPage:
    return LandingPage(
        title=TITLE,
        description=DESCRIPTION,
        version=version,
        links=[
            Link(href=url("/"), rel="self", title="This page"),
            Link(
                href=url(openapi_30.PATH),
                rel="service-desc",
                type=openapi_30.MEDIA_TYPE,
                title="OpenAPI 3.0 description",
            ),
            Link(
                href=url("/openapi.json"),
                rel="service-desc",
                type="application/vnd.oai.openapi+json;version=3.1",
                title="OpenAPI 3.1 description",
            ),
            Link(href=url("/docs"), rel="service-doc", type="text/html", title="Documentation"),
            Link(href=url("/conformance"), rel=OGC + "conformance", title="Conformance classes"),
            Link(href=url("/processes"), rel=OGC + "processes", title="Processes"),
            Link(href=url("/jobs"), rel=OGC + "job-list", title="Jobs"),
            Link(href=url("/files"), rel="related", title="Uploaded files"),
        ],
    )
