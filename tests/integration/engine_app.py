"""An application that is ready at once, for the tests of the launcher."""

from fastapi import FastAPI


def app() -> FastAPI:
    application = FastAPI()
    application.add_api_route("/readyz", lambda: {"status": "ready"})
    return application
