"""The XML section of E57 files, looked at before libE57 parses it.

libE57's parser fetches what a document type or a schema location names, from files and over the network, expands
entities without bound, and needs quadratic time for deep nesting and for many elements in one. E57 (ASTM E2807) has
none of these.
"""

import struct
from collections.abc import Iterator, Mapping
from xml.parsers.expat import ExpatError, ParserCreate

from service.errors import UnreadableFileError
from service.formats.base import ScanFile

PAGE_BYTES, CONTENT_BYTES = 1024, 1020
"""Pages end with a checksum that is no content."""
PAGES_AT_ONCE = 1024
DEEPEST = 100
"""The standard needs about ten levels."""
MOST_MEMBERS, MOST_IN_VECTOR = 1000, 10_000
"""Elements in another one, or attributes: libE57 compares each with all others. The standard has 40, and one a scan."""
VECTOR = "Vector"
FETCHED = frozenset(("schemaLocation", "noNamespaceSchemaLocation"))
PLACE = "the file's header and XML section"


def check_xml(file: ScanFile) -> None:
    """Refuse XML that is not well formed, or not such as E57 has.

    Raises
    ------
    UnreadableFileError
        It has a document type or names a schema, is nested too deeply, is not UTF-8, or damaged.
    """
    watch = _Watch(file)
    parser = ParserCreate()
    parser.XmlDeclHandler = watch.declared
    parser.StartDoctypeDeclHandler = watch.typed
    parser.StartElementHandler = watch.begun
    parser.EndElementHandler = watch.ended
    try:
        for piece in xml_section(file):
            parser.Parse(piece, False)
        parser.Parse(b"", True)
    except ExpatError as fault:
        raise file.unreadable(f"damaged E57: the XML section is not well formed: {fault}", PLACE) from None


class _Watch:
    def __init__(self, file: ScanFile) -> None:
        self._file = file
        self._left: list[int] = []
        """How many elements may come yet in each that is open."""

    def declared(self, version: str, encoding: str | None, _standalone: int) -> None:
        if version != "1.0" or (encoding or "UTF-8").upper() != "UTF-8":
            raise self._refused(f"it is XML {version} in {encoding}, not XML 1.0 in UTF-8")

    def typed(self, _name: str, _system: str | None, _public: str | None, _subset: int) -> None:
        raise self._refused("it has a document type (DOCTYPE)")

    def begun(self, _name: str, attributes: Mapping[str, str]) -> None:
        if self._left:
            self._left[-1] -= 1
        if len(attributes) > MOST_MEMBERS or min(self._left[-1:], default=0) < 0:
            raise self._refused(
                f"an element has more than {MOST_MEMBERS} members, or a vector more than {MOST_IN_VECTOR}"
            )
        self._left.append(MOST_IN_VECTOR if attributes.get("type") == VECTOR else MOST_MEMBERS)
        if len(self._left) > DEEPEST:
            raise self._refused(f"its elements are nested more than {DEEPEST} deep")
        if any(name.rpartition(":")[2] in FETCHED for name in attributes):
            raise self._refused("it names a schema to be fetched")

    def ended(self, _name: str) -> None:
        self._left.pop()

    def _refused(self, why: str) -> UnreadableFileError:
        return self._file.unreadable(f"the XML section is not such as E57 has: {why}", PLACE)


def xml_section(file: ScanFile) -> Iterator[bytes]:
    """Give the XML section piece by piece, without the checksums of the pages."""
    with file.path.open("rb") as stream:
        head = stream.read(48)
        if len(head) < 48:
            raise file.unreadable("the header is cut off", f"byte {len(head)}")
        start, length = struct.unpack_from("<QQ", head, 24)
        if start + length > file.size or start % PAGE_BYTES >= CONTENT_BYTES:
            raise file.unreadable(
                f"an XML section of {length} bytes from byte {start} does not fit a file of {file.size} bytes", PLACE
            )
        stream.seek(start - start % PAGE_BYTES)
        skip, left = start % PAGE_BYTES, length
        while left > 0 and (pages := stream.read(PAGE_BYTES * PAGES_AT_ONCE)):
            ends = range(0, len(pages), PAGE_BYTES)
            content = b"".join(pages[at : at + CONTENT_BYTES] for at in ends)[skip : skip + left]
            skip, left = 0, left - len(content)
            yield content
