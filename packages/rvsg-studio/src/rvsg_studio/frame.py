"""The frame around every page of the studio, and the plain HTML elements that pages are made of.

Text from files, models and people is only ever set as text (`tag`) or as an attribute; SVG comes from `rvsg.app`,
where everything in it is escaped.
"""

from __future__ import annotations

import asyncio
import contextlib
import functools
import json
from collections.abc import Awaitable, Callable, Container, Iterable, Iterator
from typing import Any
from urllib.parse import urlencode

from nicegui import ui
from nicegui.elements.mixins.text_element import TextElement

from rvsg.core.errors import RvsgError
from rvsg.report.answer_row import AnswerRow
from rvsg_studio.workspace import Workspace

HEAD = (
    '<link rel="icon" href="data:,"><link rel="stylesheet" href="/files/look.css">'
    '<link rel="stylesheet" href="/files/studio.css">'
    '<script src="/files/replay.js"></script><script src="/files/studio.js"></script>'
    '<script src="/files/world.js"></script><script src="/files/pages.js"></script>'
    '<script src="/files/scenario.js"></script>'
)
PATIENT_S = 600.0
"""Seconds a page may take that reads every campaign of the folder: the first time they are all read."""
Handler = Callable[[], Any] | Callable[[], Awaitable[Any]]


class Tag(TextElement):
    """An HTML element with text."""

    def __init__(self, name: str, text: str = "") -> None:
        super().__init__(tag=name, text=text)


def tag(name: str, text: str = "", *, cls: str = "", **attributes: Any) -> Tag:
    """Add an HTML element to the page; `_` in names of attributes stands for `-`, None leaves one out."""
    element = Tag(name, text)
    if cls:
        element.classes(cls)
    for key, value in attributes.items():
        if value is not None and value is not False:
            element._props[key.strip("_").replace("_", "-")] = "" if value is True else value
    return element


def svg(markup: str) -> None:
    """Add SVG made by `rvsg.app`, whose words are escaped there."""
    ui.html(markup, sanitize=False)


def link(text: str, path: str, *, cls: str = "", **query: Any) -> Tag:
    """Add a link to a page of the studio."""
    return tag("a", text, cls=cls, href=address(path, **query))


def address(path: str, **query: Any) -> str:
    """Return the address of a page of the studio."""
    arguments = {key: value for key, value in query.items() if value is not None}
    return path + (f"?{urlencode(arguments)}" if arguments else "")


class Page:
    """The page of one tab: its messages, its command lines."""

    def __init__(self, workspace: Workspace) -> None:
        self.workspace = workspace
        self._commands: Tag | None = None
        self._listed: set[str] = set()
        self.message: Tag | None = None

    def say(self, text: str, *, wrong: bool = False) -> None:
        """Show a message under the title, and read it out."""
        if self.message is not None:
            self.message.set_text(text)
            self.message.classes(replace=f"st-message{' st-wrong' if wrong else ''}")

    def command(self, what: str, line: str) -> None:
        """List the command line that does the same as an action of this page."""
        if self._commands is None or line in self._listed:
            return
        self._listed.add(line)
        with self._commands, tag("div", cls="st-command"):
            tag("span", what, cls="st-command-what")
            tag("code", line)

    def button(self, text: str, action: Handler, *, command: str = "", cls: str = "", **attributes: Any) -> Tag:
        """Add a button; an error of its action becomes a message. `command` is listed on the page."""
        element = tag(
            "button", text, cls=f"st-button {cls}".strip(), type="button", title=command or None, **attributes
        )
        element.on("click", self.guarded(action))
        if command:
            self.command(text, command)
        return element

    def guarded(self, action: Handler) -> Callable[..., Awaitable[None]]:
        """Return the action with its errors shown as a message."""

        async def acting(*_: Any) -> None:
            try:
                done = action()
                if isinstance(done, Awaitable):
                    await done
            except RvsgError as error:
                self.say(str(error), wrong=True)

        return acting


@contextlib.contextmanager
def page(workspace: Workspace, title: str, *, here: str = "", wide: bool = False, full: bool = False) -> Iterator[Page]:
    """Lay out a page: navigation, title, a line for messages, the content, and the command lines that do the same.

    Args:
        full: fill the window, so that parts of the page scroll instead of the page.
    """
    view = Page(workspace)
    ui.add_head_html(HEAD)
    ui.page_title(f"{title} – RVSG studio")
    with ui.header(fixed=False).classes(replace="st-bar"), tag("nav", cls="st-nav", aria_label="Pages"):
        tag("a", "Skip to the content", cls="st-skip", href="#content")
        tag("a", "RVSG", cls="st-brand", href="/", aria_label="RVSG studio, home")
        for path, (_, name) in sorted(workspace.menu.items(), key=lambda item: item[1]):
            tag("a", name, href=path, aria_current="page" if path == here else None)
    with tag("div", cls=f"st-main{' st-wide' if wide else ' st-full' if full else ''}", id="content", tabindex="-1"):
        tag("h1", title)
        view.message = tag("p", "", cls="st-message", role="status", aria_live="polite")
        body = tag("div", cls="st-body")
        with tag("details", cls="st-commands") as folded:
            tag("summary", "The same on the command line")
            view._commands = tag("div")
        with body:
            yield view
        folded.set_visibility(bool(view._listed))


async def load(work: Callable[..., Any], *arguments: Any, **named: Any) -> Any:
    """Do work that reads files in a thread, so that other tabs stay responsive."""
    return await asyncio.to_thread(work, *arguments, **named)  # NiceGUI's own returns None while the studio ends


Built = Callable[..., Awaitable[None]]


def route(
    workspace: Workspace, path: str, title: str, *, menu: int | None = None, patience_s: float = 60.0
) -> Callable[[Built], Built]:
    """Decorate the function that lays out the page at a path; `menu` is its place in the menu.

    An error of RVSG that it raises before anything is laid out becomes a page that says why there is nothing to show.
    """

    def add(build: Built) -> Built:
        if menu is not None:
            workspace.menu[path] = menu, title

        @ui.page(path, response_timeout=patience_s)
        @functools.wraps(build)
        async def shown(**query: Any) -> None:
            try:
                await build(**query)
            except RvsgError as error:
                with page(workspace, title):
                    tag("p", str(error), cls="st-message st-wrong")
                    tag("p", cls="soft")
                    link("Back to the overview", "/")

        return shown

    return add


@contextlib.contextmanager
def section(title: str, name: str) -> Iterator[None]:
    """Lay out a part of a page under a heading, whose id is `name`."""
    with tag("section", aria_labelledby=name):
        tag("h2", title, id=name)
        yield


@contextlib.contextmanager
def table(columns: Iterable[str], *, label: str = "", cls: str = "st-plain", **attributes: Any) -> Iterator[None]:
    """Lay out a table with these headings; its rows are the content. A long one has a label and scrolls."""
    region = {"tabindex": "0", "role": "region", "aria_label": label} if label else {}
    with tag("div", cls="scroll", **region), tag("table", cls=cls, **attributes):
        with tag("thead"), tag("tr"):
            for column in columns:
                tag("th", column, scope="col") if column else tag("td", "")
        with tag("tbody"):
            yield


def actions() -> Tag:
    """Add a line for buttons; use it as a context."""
    return tag("p", cls="st-actions")


def chip(status: str, tone: str = "") -> Tag:
    """Add a chip with a status in the colours of the report; `tone` as an answer gives it."""
    return tag("span", status, cls=f"chip {tone}".strip())


def rate(row: AnswerRow) -> None:
    """Add the share of violating runs with a bar of its interval, as the report draws it."""
    tag("span", row.share)
    if row.bounds is not None:
        low, high = row.bounds
        with tag("span", cls="rate"):
            tag("i", style=f"left:{100 * low:.1f}%;width:{100 * (high - low):.1f}%")
            tag("b", style=f"left:{100 * row.violations / row.runs:.1f}%")
        tag("span", row.interval, cls="soft small")


def field(label: str, *, help: str = "") -> Any:
    """Add a label around an input; use it as a context."""
    holder = tag("label", cls="st-field")
    with holder:
        tag("span", label, cls="st-label")
        if help:
            tag("span", help, cls="st-help")
    return holder


Changed = Callable[[str], Any]


def text_input(value: Any, changed: Changed, *, kind: str = "text", **attributes: Any) -> Tag:
    """Add an input; `changed` gets its text with every keystroke."""
    element = tag("input", type=kind, **attributes)
    element._props["^value"] = "" if value is None else str(value)
    element.on("input", lambda event: changed(str(event.args)), js_handler="(e) => emit(e.target.value)")
    return element


def number_input(value: Any, changed: Callable[[Any], Any], kind: type = int, **attributes: Any) -> Tag:
    """Add an input for a number from 0 on; `changed` gets each whole one, and None where it is empty."""

    def typed(text: str) -> None:
        with contextlib.suppress(ValueError):  # an unfinished number, e.g. "-"
            changed(kind(text) if text else None)

    return text_input(value, typed, kind="number", min="0", **attributes)


def text_area(value: str, changed: Changed, **attributes: Any) -> Tag:
    """Add an input of several lines; `changed` gets its text with every keystroke."""
    element = tag("textarea", value, **attributes)
    element.on("input", lambda event: changed(str(event.args)), js_handler="(e) => emit(e.target.value)")
    return element


def select(
    options: Iterable[str], value: str | None, changed: Changed, *, disabled: Container[str] = (), **attributes: Any
) -> Tag:
    """Add a list to choose from: the names of the options, or a dictionary of their names and texts."""
    texts = options if isinstance(options, dict) else {name: name for name in options}
    element = tag("select", **attributes)
    with element:
        for key, text in texts.items():
            option = tag("option", text, value=key, disabled=key in disabled)
            if key == value:
                option._props["^selected"] = "selected"
    element.on("change", lambda event: changed(str(event.args)), js_handler="(e) => emit(e.target.value)")
    return element


def as_script(text: str) -> str:
    """Return text as a literal of JavaScript that may stand in a page."""
    return json.dumps(text).replace("<", "\\u003c")
