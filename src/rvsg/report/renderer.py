"""Renderer of the templates, and the scripts and styles that the pages hold."""

from __future__ import annotations

import json
import re
from functools import cache
from importlib import resources
from typing import Any

import jinja2
from markupsafe import Markup

import rvsg
from rvsg.evaluation.verdict import number, percent

UNITS = "s|m|cm|m/s|m/s²|m/s³|rad|rad/s|Hz|%|USD|kB|MB|points"
_VALUE = re.compile(rf"(?<=\d) (?=(?:{UNITS})(?![\w/]))")


def unbroken(text: str) -> str:
    """Return a text in which no line breaks between a number and its unit."""
    return _VALUE.sub("\N{NO-BREAK SPACE}", text)


@cache
def _environment() -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("rvsg.report", "templates"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=lambda value: unbroken(value) if type(value) is str else value,
    )
    environment.filters |= {"number": number, "percent": percent, "px": lambda value: f"{value:.1f}"}
    environment.globals |= {"version": rvsg.__version__}
    return environment


def render(template: str, **values: Any) -> Markup:
    """Return a page or a picture.

    Everything in `values` is escaped unless it is Markup, an unknown name is an error, and no line breaks between a
    number and its unit.
    """
    return Markup(_environment().get_template(template).render(**values))  # noqa: S704 - its values are escaped


def script_safe(value: Any) -> Markup:
    """Return JSON that can stand in a script element: nothing in it can end the element."""
    text = json.dumps(value, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    return Markup(text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026"))  # noqa: S704


def component() -> str:
    """Return the JavaScript of the replay, its traces and report pages; the files in `static` say how to use them."""
    return _texts("static", "replay.js", "trace.js", "page.js")


def viewer_script(largest: int) -> str:
    """Return the JavaScript of the viewer of `.rvsg` files of at most so many bytes, unpacked."""
    return _texts("static", "viewer.js").replace("RVSG_LARGEST", str(largest))


def look() -> str:
    """Return the style sheet of the pages, that of the replay component included."""
    return _texts("templates", "plan.css", "look.css", "replay.css")


def _texts(folder: str, *names: str) -> str:
    files = resources.files("rvsg.report") / folder
    return "\n".join((files / name).read_text(encoding="utf-8") for name in names)
