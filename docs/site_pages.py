"""Pages of the documentation site that MkDocs makes while it builds, and links that leave the site.

Generated: the API of the public names and of navigation stacks (by mkdocstrings), the fields of a robot file, a page
for each code of an error, warning or finding, and the viewer of `.rvsg` files. A link to a file outside `docs` leads to
the repository where RVSG_REPOSITORY_URL names it; else the file's path stands in its place.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import griffe
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

import rvsg
from rvsg import stacks
from rvsg.app.view import viewer_page
from rvsg.cli.codes import explanation, sources
from rvsg.robots.robot import Robot

ROOT = Path(__file__).resolve().parent.parent


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the generated pages."""
    for path, text in generated_pages():
        files.append(File.generated(config, path, content=text))
    files.append(File.generated(config, "viewer.html", content=viewer_page()))
    return files


def on_page_markdown(markdown: str, *, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Begin the first page as the README does; lead links out of `docs` to the repository."""
    if page.file.src_uri == "index.md":
        begin = (ROOT / "README.md").read_text(encoding="utf-8").split("\n## ")[0].partition("\n")[2]
        begin = re.sub(r"\]\((?!\w+:)", "](../", begin).replace("](../docs/", "](")
        markdown = re.sub(r"^- \[README\].*\n", "", markdown.replace("\n\n", f"\n{begin}\n", 1), flags=re.M)
    folder = (ROOT / "docs" / page.file.src_uri).parent

    def leading(found: re.Match[str]) -> str:
        target = (folder / found[2]).resolve()
        if "://" in found[2] or target.is_relative_to(ROOT / "docs") or not target.is_relative_to(ROOT):
            return found[0]
        path = target.relative_to(ROOT).as_posix()
        return f"{found[1]}({config.repo_url}/blob/main/{path})" if config.repo_url else f"{found[1][1:-1]} (`{path}`)"

    return re.sub(r"(\[[^\]]*\])\(([^)#\s]+)(?:#[^)]*)?\)", leading, markdown)


def generated_pages() -> Iterator[tuple[str, str]]:
    """Yield the path and the text of every generated page."""
    yield (
        "reference/python.md",
        "# The Python interface\n\n" + "".join(f"::: rvsg.{name}\n\n" for name in rvsg.__all__[1:]),
    )
    yield (
        "reference/stack-api.md",
        "# The interface of navigation stacks\n\nMetres, seconds, radians.\n\n"
        + "".join(f"::: rvsg.stacks.{name}\n\n" for name in stacks.__all__),
    )
    yield "reference/robot-file.md", "".join(robot_page())
    codes = sources()
    listed = "".join(
        f"| [`{code}`](codes/{code}.md) | {found[0].what or found[0].why} |\n" for code, found in codes.items()
    )
    yield "reference/codes.md", f"# Codes of errors and findings\n\n| code | reported |\n|---|---|\n{listed}"
    for code in codes:
        yield f"reference/codes/{code}.md", explanation(code)


def robot_page() -> Iterator[str]:
    """Yield the tables of the fields of a robot file: those of the robot, then those of the records inside it."""
    yield "# The robot file\n\nMetres, seconds and radians in the base frame: x forward, y left.\n"
    schema = Robot.model_json_schema()
    source = griffe.load("rvsg.robots.robot", search_paths=[ROOT / "src"])
    for name, record in {"Robot": schema, **schema["$defs"]}.items():
        yield f"\n## {name}\n\n{source[name].docstring.value}\n\n"
        yield "| key | value | default | meaning |\n|---|---|---|---|\n"
        for key, field in record["properties"].items():
            text = source[name][key].docstring
            default = "required" if key in record.get("required", ()) else f"`{field['default']}`"
            shown = default if "$ref" not in field and len(default) < 40 else "see there"
            meaning = " ".join(text.value.split()) if text else ""
            yield f"| `{key}` | {value_of(field)} | {'' if default == '`None`' else shown} | {meaning} |\n"


def value_of(field: dict[str, Any]) -> str:
    """Return the values that a field of a JSON schema takes."""
    if "anyOf" in field:
        return " or ".join(value_of(each) for each in field["anyOf"])
    if "$ref" in field:
        name = field["$ref"].rpartition("/")[2]
        return f"[{name}](#{name.lower()})"
    if "enum" in field:
        return ", ".join(f"`{each}`" for each in field["enum"])
    if field["type"] == "array":
        inside = field.get("items") or field["prefixItems"][0]
        return f"list of {value_of(inside)}"
    bounds = {"minimum": "at least", "exclusiveMinimum": "over", "maximum": "at most", "exclusiveMaximum": "under"}
    limits = [f"{words} {field[key]:.4g}" for key, words in bounds.items() if key in field]
    kind = {
        "number": "number",
        "integer": "whole number",
        "boolean": "true or false",
        "string": "text",
        "null": "nothing",
    }
    return ", ".join([kind[field["type"]], *limits])
