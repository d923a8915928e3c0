"""Sessions of browsers: the key with which somebody logged in, sealed, for the browser to keep.

Nothing is stored here. A session is opened with the service's own secret and gives the key again, which is then looked
up like any other: a key that is revoked or has run out ends its sessions with it.
"""

from datetime import datetime, timedelta

from service.errors import StorageError
from service.refusals import NoSessionsError
from service.settings import Settings
from service.use_cases.access.sealed_secrets import SEALED, Seal, seal_of

LASTS = timedelta(hours=12)
OF_BROWSERS = "(browser session)"
"""In the place of a project, none of which can be called so: what is sealed for a project opens no session."""
LONGEST = 2000


class BrowserSessions:
    """Seal and open sessions.

    Parameters
    ----------
    settings
        With the secret, or the directory where it lies.
    """

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._known: Seal | None = None

    def begin(self, key: str, now: datetime) -> str:
        """Give what a browser keeps of a key, in characters that a cookie may have.

        Raises
        ------
        NoSessionsError
            The machines of this service share no secret.
        """
        seal = self._seal()
        if seal is None:
            raise NoSessionsError
        until = int((now + LASTS).timestamp())
        box = seal.sealed(f"{until} {key}", OF_BROWSERS).removeprefix(SEALED)
        return box.rstrip("=").replace("+", "-").replace("/", "_")

    def key_of(self, kept: str, now: datetime) -> str | None:
        """Give the key of a session; None when it is none, or has lasted too long."""
        seal = self._seal() if kept and len(kept) <= LONGEST else None
        if seal is None:
            return None
        box = kept.replace("-", "+").replace("_", "/")
        try:
            until, _, key = seal.opened(f"{SEALED}{box}{'=' * (-len(box) % 4)}", OF_BROWSERS).partition(" ")
        except (StorageError, ValueError):
            return None
        return key if int(until) > now.timestamp() else None

    def _seal(self) -> Seal | None:
        if self._known is None:
            self._known = seal_of(self._settings)
        return self._known
