"""Networks in the files of other programs, read at the door."""

from collections.abc import Callable, Mapping
from typing import Annotated, Any, Literal
from xml.etree.ElementTree import Element, ParseError

from defusedxml import DefusedXmlException
from defusedxml.ElementTree import fromstring
from pydantic import Field, ValidationError
from pydantic_core import PydanticCustomError

from schemas.requests.gama_networks import network_of_gama
from schemas.requests.jag3d_networks import network_of_jag3d
from schemas.values.base import RequestModel
from schemas.values.text_counts import too_long
from schemas.values.texts_elsewhere import require_reading_here


def _network_of_riscan(root: Element) -> dict[str, Any]:
    # numpy is loaded by who sends such a project, not by every web process
    from schemas.requests.riscan_projects import network_of_riscan

    return network_of_riscan(root)


FORMATS: Mapping[str, Callable[[Element], dict[str, Any]]] = {
    "gama-local": network_of_gama,
    "riscan-project": _network_of_riscan,
}


class NetworkText(RequestModel):
    """A network as the text of a file of another program."""

    format: Literal["gama-local", "riscan-project"]
    """`gama-local`: GNU Gama's input (.gkf) with spatial observations; `riscan-project`: project.rsp of RiSCAN PRO with
    tie points."""
    xml: Annotated[str, Field(min_length=1, max_length=20_000_000)]
    """The file's text."""


class Jag3dFile(RequestModel):
    """A text file of JAG3D."""

    type: Literal[
        "reference-points", "stochastic-points", "datum-points", "new-points", "directions", "zenith-angles",
        "slope-distances", "horizontal-distances", "height-differences",
    ]  # fmt: skip
    """What its lines are."""
    text: Annotated[str, Field(max_length=20_000_000)]
    """Its lines."""
    std: Annotated[float, Field(gt=0.0, lt=1.0)] | None = None
    """Standard deviation of lines that state none: gon of directions and zenith angles, metres of all else."""


class Jag3dTexts(RequestModel):
    """A network as JAG3D's text files."""

    format: Literal["jag3d"]
    """That the files are JAG3D's."""
    files: Annotated[list[Jag3dFile], Field(min_length=1, max_length=1000)]
    """One of each type, or several."""


def network_dictionary(given: Any) -> Any:
    """Give the network of a text in place of it, in the layout `hybrid-network/1`; what is none goes through as it is.

    Raises
    ------
    PydanticCustomError
        No XML, XML that declares entities, or what this service has no observation for, by name.
    """
    if not isinstance(given, dict) or (given.get("format") != "jag3d" and "xml" not in given):
        return given
    require_reading_here()
    if given.get("format") == "jag3d":
        return _of_jag3d(given)
    read = FORMATS.get(str(given.get("format")))
    unknown = set(given) - {"format", "xml"}
    if read is None or unknown or not isinstance(given["xml"], str):
        raise _fault(f"a network as text has `format`, one of {', '.join(FORMATS)}, and `xml`, and nothing else")
    if (what := too_long(given["xml"])) is not None:
        raise _fault(what)
    try:
        root = fromstring(given["xml"])
    except DefusedXmlException as error:
        raise _fault(f"this XML declares entities or refers to other files, and is not read: {error}") from None
    except (ParseError, ValueError) as error:
        raise _fault(f"this is no XML: {error}") from None
    try:
        return _as_tuples(read(root))
    except ValueError as error:
        raise _fault(str(error)) from None


def _of_jag3d(given: dict[str, Any]) -> Any:
    try:
        texts = Jag3dTexts.model_validate(given)
    except ValidationError as error:
        first = error.errors()[0]
        raise _fault(f"jag3d: {'/'.join(str(part) for part in first['loc'])}: {first['msg']}") from None
    if (what := too_long(*(file.text for file in texts.files))) is not None:
        raise _fault(what)
    try:
        return _as_tuples(network_of_jag3d([file.model_dump() for file in texts.files]))
    except ValueError as error:
        raise _fault(str(error)) from None


def _fault(what: str) -> PydanticCustomError:
    return PydanticCustomError("network_text", "{what}", {"what": what})


def _as_tuples(value: Any) -> Any:
    """Give triples as JSON's arrays are given to strict eyes: as tuples where they hold numbers only."""
    if isinstance(value, dict):
        return {key: _as_tuples(each) for key, each in value.items()}
    if isinstance(value, list):
        members = [_as_tuples(each) for each in value]
        return tuple(members) if members and all(isinstance(m, float | tuple) for m in members) else members
    return value
