"""What a client wants to get, from its Accept header (RFC 9110, 12.5.1)."""

from functools import lru_cache


def accepts_plain_json_only(accept: str) -> bool:
    """Tell whether `application/json` is all that a client takes."""
    return accepts_only(accept, "application/json")


def accepts_only(accept: str, media_type: str) -> bool:
    """Tell whether a media type is all that a client takes."""
    return {name for name, _ in _ranges(accept)} == {media_type}


@lru_cache(maxsize=200)
def prefers_html(accept: str) -> bool:
    """Tell whether a client, such as a browser, would rather see a page than JSON."""
    weights = dict(_ranges(accept))
    html = max(weights.get("text/html", 0.0), weights.get("application/xhtml+xml", 0.0))
    return html > 0.0 and html >= weights.get("application/json", 0.0)


def _ranges(accept: str) -> list[tuple[str, float]]:
    ranges = []
    for part in accept.lower().split(","):
        name, *parameters = (piece.strip() for piece in part.split(";"))
        weight = next((p.removeprefix("q=") for p in parameters if p.startswith("q=")), "1")
        if name:
            ranges.append((name, _number(weight)))
    return [(name, weight) for name, weight in ranges if weight > 0.0]


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return 1.0
