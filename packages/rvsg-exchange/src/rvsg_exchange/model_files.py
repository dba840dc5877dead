"""Files that a Gazebo world refers to, found on this machine only: folders, packages, the Fuel cache."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from urllib.parse import unquote, urlparse
from xml.parsers import expat

from rvsg.core import inputs
from rvsg.core.documents import Problem
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
    path: Path = Path()

    @property
    def name(self) -> str:
        """The attribute `name`; empty without one."""
        return self.attributes.get("name", "")

    def is_true(self, tag: str) -> bool:
        """Return whether the first child of that tag says true or 1."""
        return self.text_of(tag).lower() in ("true", "1")

    def set_path(self, path: Path) -> Element:
        """Say which file the element and all in it are from; return it."""
        self.path = path
        for child in self.children:
            child.set_path(path)
        return self

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


class Problems(list[Problem]):
    """What is wrong in a world and the files it includes."""

    def add(self, element: Element, message: str, code: str) -> None:
        """Add a problem of an element."""
        self.append(Problem(element.path, element.line, message, code=code))

    def numbers(self, element: Element, count: int) -> list[float]:
        """Return `count` finite numbers of an element's text; zeros and 1, and a problem, where it holds others."""
        try:
            values = [float(part) for part in element.text.split()]
        except ValueError:
            values = []
        if len(values) == count and all(math.isfinite(v) for v in values):
            return values
        message = f'<{element.tag}> must be {count} finite numbers, got "{element.text.strip()[:80]}"'
        self.add(element, message, "sdf-numbers")
        return [0.0] * (count - 1) + [1.0]

    def numbers_of(self, parent: Element, tag: str, otherwise: Sequence[float]) -> list[float]:
        """Return as many numbers of a child as `otherwise` has, which holds where there is no such child."""
        child = parent.find(tag)
        return list(otherwise) if child is None else self.numbers(child, len(otherwise))


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
        line = parser.CurrentLineNumber + line_offset
        element = Element(tag.rpartition(":")[2], dict(attributes), line, path=path)
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
    """Return the text without what stands before its first `<`, and how many lines that was; Latin-1 if no UTF-8."""
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


PATH_VARIABLES = ("GAZEBO_MODEL_PATH", "GZ_SIM_RESOURCE_PATH", "IGN_GAZEBO_RESOURCE_PATH", "SDF_PATH")
PACKAGE_VARIABLES = ("ROS_PACKAGE_PATH",)
PREFIX_VARIABLES = ("AMENT_PREFIX_PATH", "CMAKE_PREFIX_PATH")
CACHE_VARIABLES = ("GZ_FUEL_CACHE_PATH", "IGN_FUEL_CACHE_PATH")
WEB = ("http", "https", "fuel")
SCHEMES = ("model", "package", "file", "", *WEB)
_FUEL = re.compile(
    r"(?:\d+\.\d+/)?(?P<owner>[^/]+)/models/(?P<name>[^/]+)(?:/(?P<version>\d+|tip))?(?:/files)?(?P<rest>/.*)?"
)


class ModelFiles:
    """Looks up URIs in the given folders, the folders around the world file, Gazebo's variables and its caches."""

    def __init__(self, world: Path, given: Sequence[Path] = ()) -> None:
        folder = world.resolve().parent
        found = [*given, folder, folder / "models", folder.parent / "models", folder.parent]
        for name in (*PATH_VARIABLES, *PACKAGE_VARIABLES):
            found += _listed(name)
        for name in PREFIX_VARIABLES:
            found += [path / "share" for path in _listed(name)]
        home = Path(os.environ.get("HOME") or Path.home())
        found.append(home / ".gazebo" / "models")
        self.folders: tuple[Path, ...] = tuple(dict.fromkeys(found))
        caches = [path for name in CACHE_VARIABLES for path in _listed(name)]
        self.caches = (*caches, home / ".gz" / "fuel", home / ".ignition" / "fuel")

    def find(self, uri: str, base: Path) -> Path | None:
        """Return the file or folder of a URI that is written in the file `base`; None if it is not on this machine."""
        scheme, rest = split(uri)
        if ".." in Path(rest).parts and scheme != "":
            return None
        return next((path for path in self._candidates(scheme, rest, base) if path.exists()), None)

    def searched(self, uri: str, base: Path) -> tuple[Path, ...]:
        """Return the folders in which a URI is looked for, in order."""
        scheme, rest = split(uri)
        if scheme in WEB:
            return (*self.caches, *self.folders)
        if scheme == "file" and rest.startswith("/"):
            return (Path(rest).parent,)
        return tuple(dict.fromkeys((*self.folders, base.parent if scheme == "" else base.parent.parent)))

    def _candidates(self, scheme: str, rest: str, base: Path) -> list[Path]:
        folders = (*self.folders, base.parent.parent)
        if scheme in WEB:
            return [*self._in_fuel_cache(rest), *(folder / _fuel_tail(rest) for folder in folders)]
        if scheme == "file" and rest.startswith("/"):
            return [Path(rest)]
        found = [folder / rest for folder in folders]
        if scheme == "":
            found.insert(0, base.parent / rest)
        if scheme in ("package", "file", "model"):
            package, _, inner = rest.partition("/")
            found += [folder / inner for folder in base.resolve().parents if _package(folder) == package]
        if scheme == "file":  # written relative to the root of a checkout: file://models/chair/meshes/chair.dae
            found += [folder / rest for folder in list(base.resolve().parents)[:5]]
        return found

    def _in_fuel_cache(self, rest: str) -> list[Path]:
        host, _, address = rest.partition("/")
        match = _FUEL.fullmatch(address.rstrip("/"))
        if match is None:
            return []
        inner = (match["rest"] or "").lstrip("/")
        found = []
        for cache_folder in self.caches:
            model = cache_folder / host / match["owner"].lower() / "models" / match["name"].lower()
            found += [version / inner if inner else version for version in _versions(model, match["version"])]
        return found


def split(uri: str) -> tuple[str, str]:
    """Return the scheme and the rest of a URI, percent signs decoded."""
    try:
        parsed = urlparse(uri.strip())
    except ValueError:  # such as a bracket that is not closed; no file has that name
        return "", uri.strip()
    if parsed.scheme in WEB:
        return parsed.scheme, unquote(parsed.netloc.lower() + parsed.path)
    return parsed.scheme, unquote(parsed.netloc + parsed.path)


def model_of(uri: str) -> str:
    """Return the name by which a missing file is reported: the model, package or Fuel model it belongs to."""
    scheme, rest = split(uri)
    if scheme in WEB:
        return _fuel_tail(rest).partition("/")[0]
    return rest.partition("/")[0] if scheme in ("model", "package") else rest


def _fuel_tail(rest: str) -> str:
    """Return the model's name, with the file in it if the address names one."""
    match = _FUEL.fullmatch(rest.partition("/")[2].rstrip("/"))
    if match is None:
        return rest.rstrip("/").rpartition("/")[2]
    return match["name"] + (match["rest"] or "")


def _versions(model: Path, wanted: str | None) -> list[Path]:
    if wanted and wanted != "tip":
        return [model / wanted]
    if not model.is_dir():
        return []
    numbered = [path for path in model.iterdir() if path.name.isdecimal()]
    return sorted(numbered, key=lambda path: -int(path.name))


def _listed(name: str) -> list[Path]:
    return [Path(part) for part in os.environ.get(name, "").split(os.pathsep) if part]


@cache
def _package(folder: Path) -> str | None:
    """Return the name of the ROS package whose root a folder is."""
    manifest = folder / "package.xml"
    if not manifest.is_file():
        return None
    try:
        return read_xml(manifest).text_of("name") or folder.name
    except FileError:
        return folder.name


def model_file(folder: Path) -> Path | None:
    """Return the SDF (or URDF) file of a model folder: the newest version in model.config, else model.sdf."""
    for candidate in (*_named_in_config(folder), folder / "model.sdf", folder / "model.urdf"):
        if candidate.is_file():
            return candidate
    alone = sorted(folder.glob("*.sdf"))
    return alone[0] if len(alone) == 1 else None


def _named_in_config(folder: Path) -> list[Path]:
    """Return the files that model.config names, the newest SDF version first; none if it cannot be read."""
    config = folder / "model.config"
    if not config.is_file():
        return []
    try:
        entries = read_xml(config).all("sdf")
    except FileError:
        return []
    named = []
    for entry in entries:
        version = tuple(
            int(p) if p.isdecimal() and len(p) < 10 else 0 for p in entry.attributes.get("version", "0").split(".")
        )
        named.append((version, entry.text.strip()))
    return [folder / name for _, name in sorted(named, reverse=True) if name]
