"""Long lists, piece by piece."""

from dataclasses import dataclass, field, replace
from urllib.parse import urlencode

from fastapi import Request

SIZE = 50
FARTHEST = 2**31 - 1


@dataclass(frozen=True)
class Piece:
    """Which part of a list is shown, and where the others are."""

    begin: int
    total: int = 0
    query: tuple[tuple[str, str], ...] = field(default=())
    """What else was asked for."""
    size: int = SIZE

    def of(self, total: int) -> "Piece":
        """Give it with the length of the whole list."""
        return replace(self, total=total)

    @property
    def end(self) -> int:
        """Number of the last entry shown, from 1."""
        return min(self.begin + self.size, self.total)

    @property
    def before(self) -> str | None:
        """Where the entries before these are; None: there are none."""
        return self._address(max(0, self.begin - self.size)) if self.begin > 0 else None

    @property
    def after(self) -> str | None:
        """Where the entries after these are; None: there are none."""
        return self._address(self.begin + self.size) if self.begin + self.size < self.total else None

    def _address(self, begin: int) -> str:
        return "?" + urlencode([*self.query, ("offset", str(begin))])


def piece_of(request: Request, kept: tuple[str, ...] = ("lang",)) -> Piece:
    """Give the piece that is asked for; what is no number is the beginning."""
    text = request.query_params.get("offset", "")
    begin = min(int(text), FARTHEST) if text.isascii() and text.isdecimal() and len(text) < len(str(FARTHEST)) else 0
    query = tuple((name, value) for name, value in request.query_params.multi_items() if name in kept and value)
    return Piece(begin, query=query)
