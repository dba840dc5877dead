"""XML read safely and with line numbers: no document type, no entities, nothing fetched, bounded size and depth."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

from rvsg.core import inputs
from rvsg.core.errors import FileError

LARGEST_FILE_BYTES = 256 * 1024 * 1024
MOST_ELEMENTS = 2_000_000
DEEPEST = 200


@dataclass(eq=False)
class Element:
    """One element: its tag without namespace prefix, attributes, own text, children, and the line it starts in."""

    tag: str
    attributes: dict[str, str]
    line: int
    text: str = ""
    children: list[Element] = field(default_factory=list)

    def find(self, tag: str) -> Element | None:
        """Return the first child of that tag."""
        return next((child for child in self.children if child.tag == tag), None)

    def all(self, *tags: str) -> list[Element]:
        """Return all children with one of the tags, in document order."""
        return [child for child in self.children if child.tag in tags]

    def text_of(self, tag: str, otherwise: str = "") -> str:
        """Return the stripped text of the first child of that tag."""
        child = self.find(tag)
        return child.text.strip() if child is not None else otherwise


class _Forbidden(Exception):
    pass


def read_xml(path: str | Path) -> Element:
    """The root element of an XML file; FileError with the line for anything malformed, forbidden or too large."""
    path = Path(path)
    return parse_xml(path, read_bytes(path))


def parse_xml(path: Path, content: bytes, *, keep: bool = True) -> Element:
    """Return the root element of XML text; with `keep` False only its shape is checked and the root returned empty."""
    content, line_offset = _tidied(content)
    root: list[Element] = []
    stack: list[Element] = []
    count = 0
    parser = expat.ParserCreate()
    parser.buffer_text = True

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal count
        count += 1
        if count > MOST_ELEMENTS:
            raise _Forbidden(f"the file holds more than {MOST_ELEMENTS} elements.")
        if len(stack) >= DEEPEST:
            raise _Forbidden(f"the elements are nested more than {DEEPEST} deep.")
        element = Element(tag.rpartition(":")[2], dict(attributes), parser.CurrentLineNumber + line_offset)
        if keep and stack:
            stack[-1].children.append(element)
        elif not root:
            root.append(element)
        stack.append(element)

    def end(_tag: str) -> None:
        stack.pop()

    def text(data: str) -> None:
        if keep and stack:
            stack[-1].text += data

    def forbid(*_details: object) -> int:
        raise _Forbidden("a document type or entity declaration is not accepted; remove it from the file.")

    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.CharacterDataHandler = text
    parser.StartDoctypeDeclHandler = forbid
    parser.EntityDeclHandler = forbid
    parser.ExternalEntityRefHandler = forbid
    try:
        parser.Parse(content, True)
    except expat.ExpatError as error:
        reason = expat.errors.messages[error.code] if error.code in expat.errors.messages else str(error)
        raise FileError(
            path, f"this is not well-formed XML: {reason}.", line=error.lineno + line_offset, code="xml-malformed"
        ) from None
    except _Forbidden as error:
        raise FileError(path, str(error), line=parser.CurrentLineNumber + line_offset, code="xml-refused") from None
    except (LookupError, ValueError) as error:
        raise FileError(path, f"this XML cannot be read: {error}.", code="xml-malformed") from None
    return root[0]


def _tidied(content: bytes) -> tuple[bytes, int]:
    """Return the text without what stands before its first `<`, and how many lines that was.

    Gazebo's reader takes blank lines and a byte-order mark before the XML declaration, and bytes that are not UTF-8
    (read as Latin-1 here).
    """
    content = content.removeprefix(b"\xef\xbb\xbf")
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        return content, 0
    rest = content.lstrip()
    skipped = content[: len(content) - len(rest)].count(b"\n")
    if b"encoding=" not in rest[:200].lower() or b"utf-8" in rest[:200].lower():
        try:
            rest.decode("utf-8")
        except UnicodeDecodeError:
            rest = rest.decode("latin-1").encode("utf-8")
    return rest, skipped


def read_bytes(path: Path) -> bytes:
    """Return the content of a file of at most LARGEST_FILE_BYTES, or a FileError that says why it cannot be read."""
    return inputs.read_bytes(path, largest=LARGEST_FILE_BYTES)
