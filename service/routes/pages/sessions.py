"""Log in with a key, and log out."""

from urllib.parse import parse_qs

from fastapi import Request, Response
from starlette.routing import Route

from service.refusals import UnauthenticatedError
from service.routes.page_answers import PageRoute, access_of, elsewhere, page
from service.routes.request_bodies import body_of, read_within
from service.routes.session_cookies import begin_session, end_session
from service.use_cases.access.check_access import NOBODY, WITHOUT_KEY

LONGEST_FORM = 4000


async def login_page(request: Request) -> Response:
    """Ask for a key, unless it is known already."""
    if access_of(request) is not NOBODY:
        return elsewhere(request, "/")
    return page(request, "login", {"back": _local(request.query_params.get("next", "/")), "refused": False})


async def log_in(request: Request) -> Response:
    """Begin a session with the key in the form."""
    form = parse_qs((await read_within("the form", body_of(request), LONGEST_FORM)).decode(errors="replace"))
    key, back = form.get("key", [""])[0].strip(), _local(form.get("next", ["/"])[0])
    remote = request.client.host if request.client else ""
    try:
        access = await request.app.state.gatekeeper.access(f"Bearer {key}", remote)
    except UnauthenticatedError:
        return page(request, "login", {"back": back, "refused": True}, status=UnauthenticatedError.status)
    answer = elsewhere(request, back)
    if access is not WITHOUT_KEY:
        await begin_session(request, answer, key)
    return answer


async def log_out(request: Request) -> Response:
    """End the session."""
    answer = elsewhere(request, "/")
    await end_session(request, answer)
    return answer


def _local(path: str) -> str:
    """Give where to go after a login: a place of this service, whatever a link says."""
    safe = path.startswith("/") and not path.startswith(("//", "/\\")) and path.isprintable()
    return path if safe and path not in {"/login", "/logout"} else "/"


ROUTES = (
    PageRoute("/login", login_page),
    Route("/login", log_in, methods=["POST"]),
    Route("/logout", log_out, methods=["POST"]),
)
