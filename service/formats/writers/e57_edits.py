"""New poses in the XML section of an E57 file: each change is a few bytes, all others stay as they are."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from xml.parsers.expat import ParserCreate
from xml.sax.saxutils import escape

from scipy.spatial.transform import RigidTransform

ROOT = "e57Root"
ENTRY = "vectorChild"
LISTS = ("data3D", "images2D")
METADATA = "coordinateMetadata"
TAG = re.compile(rb"""<(?:[^"'>]|"[^"]*"|'[^']*')*>""")


@dataclass
class Span:
    """An element: where it begins and ends, and where its content does [byte]."""

    name: str
    start: int
    content: int
    content_end: int = 0
    end: int = 0
    children: dict[str, "Span"] = field(default_factory=dict)

    @property
    def is_closed_at_once(self) -> bool:
        """Whether it is written as one tag without content."""
        return self.content_end < self.content


@dataclass(frozen=True)
class Entries:
    """Where the scans, the images and the reference system stand."""

    root: Span
    lists: Mapping[str, list[Span]]


def entries_of(xml: bytes) -> Entries:
    """Find the scans and images of an XML section that was checked before."""
    finder = _Finder(xml)
    parser = ParserCreate()
    parser.StartElementHandler = lambda name, _: finder.begun(name, parser.CurrentByteIndex)
    parser.EndElementHandler = lambda _: finder.ended(parser.CurrentByteIndex)
    parser.Parse(xml, True)
    return Entries(finder.root, finder.lists)


def with_poses(
    xml: bytes,
    scans: Mapping[int, RigidTransform],
    images: Mapping[int, RigidTransform],
    crs_wkt: str | None = None,
) -> bytes:
    """Give the XML section with other poses, and with another reference system where one is given.

    Parameters
    ----------
    xml
        The section as it is.
    scans, images
        The poses in the file's common frame, by number.
    crs_wkt
        Of the common frame; None: what the file says stays.
    """
    entries = entries_of(xml)
    edits: list[tuple[int, int, bytes]] = []
    for name, poses in zip(LISTS, (scans, images), strict=True):
        for number, pose in poses.items():
            edits += _pose_edits(entries.lists[name][number], pose)
    if crs_wkt is not None:
        text = f'<{METADATA} type="String">{escape(crs_wkt)}</{METADATA}>'
        edits.append(_set(entries.root, METADATA, text))
    for start, end, text_bytes in sorted(edits, reverse=True):
        xml = xml[:start] + text_bytes + xml[end:]
    return xml


class _Finder:
    def __init__(self, xml: bytes) -> None:
        self._xml = xml
        self._stack: list[tuple[str, Span]] = []
        self.root = Span(ROOT, 0, 0)
        self.lists: dict[str, list[Span]] = {name: [] for name in LISTS}

    def begun(self, name: str, at: int) -> None:
        span = Span(name, at, _after_tag(self._xml, at))
        path = [each for each, _ in self._stack]
        if not path:
            self.root = span
        elif len(path) == 2 and path[1] in LISTS and name == ENTRY:
            self.lists[path[1]].append(span)
        elif len(path) == 1 or path[1] in LISTS:
            self._stack[-1][1].children.setdefault(name, span)
        self._stack.append((name, span))

    def ended(self, at: int) -> None:
        _, span = self._stack.pop()
        if self._xml[span.content - 2 : span.content] == b"/>":
            span.content_end, span.end = span.content - 2, span.content
        else:
            span.content_end, span.end = at, _after_tag(self._xml, at)


def _after_tag(xml: bytes, at: int) -> int:
    """Give where the tag that begins here ends; attributes may hold a bracket."""
    found = TAG.match(xml, at)
    if found is None:
        raise ValueError("a tag does not end")
    return found.end()


def _pose_edits(entry: Span, pose: RigidTransform) -> list[tuple[int, int, bytes]]:
    quaternion = pose.rotation.as_quat(canonical=True, scalar_first=True).tolist()
    rotation = _structure("rotation", dict(zip("wxyz", quaternion, strict=True)))
    translation = _structure("translation", dict(zip("xyz", pose.translation.tolist(), strict=True)))
    old = entry.children.get("pose")
    if old is None or old.is_closed_at_once:
        return [_set(entry, "pose", f'<pose type="Structure">{rotation}{translation}</pose>')]
    edits = [_set(old, "rotation", rotation), _set(old, "translation", translation)]
    if edits[0][:2] == edits[1][:2]:  # both are missing, so both come to the same place
        return [(*edits[0][:2], edits[0][2] + edits[1][2])]
    return edits


def _structure(name: str, numbers: Mapping[str, float]) -> str:
    inner = "".join(f'<{key} type="Float">{number!r}</{key}>' for key, number in numbers.items())
    return f'<{name} type="Structure">{inner}</{name}>'


def _set(parent: Span, name: str, text: str) -> tuple[int, int, bytes]:
    """Give the edit that replaces a child, or adds it as the last one."""
    old = parent.children.get(name)
    if old is not None:
        return old.start, old.end, text.encode()
    if parent.is_closed_at_once:
        return parent.content_end, parent.end, f">{text}</{parent.name}>".encode()
    return parent.content_end, parent.content_end, text.encode()
