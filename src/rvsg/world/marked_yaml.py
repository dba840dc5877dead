"""YAML read safely, with the line of every value, so that a finding can say where in the file it lies."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from rvsg.errors import FileError

LARGEST_FILE_BYTES = 64 * 1024 * 1024
MOST_NODES = 5_000_000
_Loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


@dataclass(frozen=True, kw_only=True)
class Marked:
    """The content of a YAML file as plain data, and where in the file each part of it stands."""

    path: Path
    value: Any
    node: Any

    def line(self, *keys: str | int) -> int:
        """The line (from 1) of the value under `keys`; of the deepest part that exists where one is missing."""
        node, line = self.node, 1
        for key in keys:
            found = _child(node, key)
            if found is None:
                break
            line, node = found
        return line

    def error(self, message: str, *keys: str | int) -> FileError:
        """A FileError that points at the value under `keys`."""
        return FileError(self.path, message, line=self.line(*keys))


def _child(node: Any, key: str | int) -> tuple[int, Any] | None:
    if isinstance(node, yaml.MappingNode):
        for name, value in node.value:
            if isinstance(name, yaml.ScalarNode) and name.value == str(key):
                return name.start_mark.line + 1, value
    elif isinstance(node, yaml.SequenceNode) and isinstance(key, int) and 0 <= key < len(node.value):
        return node.value[key].start_mark.line + 1, node.value[key]
    return None


def read_text(path: Path, *, largest_bytes: int = LARGEST_FILE_BYTES) -> str:
    """The text of a file as UTF-8, or a FileError that says why it cannot be read."""
    if path.is_dir():
        raise FileError(path, "this is a folder; expected a file.")
    try:
        size = path.stat().st_size
        if size > largest_bytes:
            raise FileError(path, f"the file has {size} bytes; at most {largest_bytes} are read.")
        return path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise FileError(path, "there is no such file.") from None
    except UnicodeDecodeError as error:
        raise FileError(path, f"expected UTF-8 text; byte {error.start} is not. Is this the right file?") from None
    except OSError as error:
        raise FileError(path, f"the file cannot be read: {error.strerror}.") from None


def read_marked(path: str | Path) -> Marked:
    """Read a YAML file. Only plain data is built, never objects.

    FileError (with the line) for what is not YAML, for a key given twice in one mapping, and for aliases that
    refer to themselves or unfold to millions of values.
    """
    path = Path(path)
    text = read_text(path)
    loader = _Loader(text)
    try:
        node = loader.get_single_node()
        if node is not None:
            _refuse_double_keys_and_bombs(path, node)
        value = loader.construct_document(node) if node is not None else None
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        problem = getattr(error, "problem", None) or getattr(error, "reason", None) or str(error)
        line = mark.line + 1 if mark is not None else None
        raise FileError(path, f"this is not valid YAML: {problem}.", line=line) from None
    except (ValueError, TypeError) as error:
        raise FileError(path, f"this is not valid YAML: {error}.") from None
    finally:
        loader.dispose()
    return Marked(path=path, value=value, node=node)


def _refuse_double_keys_and_bombs(path: Path, root: Any) -> None:
    sizes: dict[int, int] = {}
    open_nodes: set[int] = set()
    stack: list[tuple[Any, bool]] = [(root, False)]
    while stack:
        node, done = stack.pop()
        children = _children(node)
        if done:
            open_nodes.discard(id(node))
            sizes[id(node)] = 1 + sum(sizes[id(child)] for child in children)
            if sizes[id(node)] > MOST_NODES:
                raise FileError(path, f"aliases unfold to more than {MOST_NODES} values.", line=_line(node))
            continue
        if id(node) in sizes:
            continue
        if id(node) in open_nodes:
            raise FileError(path, "an alias refers to the value it stands in.", line=_line(node))
        open_nodes.add(id(node))
        if isinstance(node, yaml.MappingNode):
            _refuse_double_keys(path, node)
        stack.append((node, True))
        stack.extend((child, False) for child in reversed(children))


def _children(node: Any) -> list[Any]:
    if isinstance(node, yaml.MappingNode):
        return [part for pair in node.value for part in pair]
    return list(node.value) if isinstance(node, yaml.SequenceNode) else []


def _refuse_double_keys(path: Path, node: Any) -> None:
    seen: dict[str, int] = {}
    for name, _ in node.value:
        if not isinstance(name, yaml.ScalarNode):
            raise FileError(path, "a key must be a plain word or number.", line=_line(name))
        if name.value in seen and name.value != "<<":
            raise FileError(
                path, f'the key "{name.value}" is given twice (first in line {seen[name.value]}).', line=_line(name)
            )
        seen[name.value] = _line(name)


def _line(node: Any) -> int:
    return int(node.start_mark.line) + 1
