"""Review what a model wrote of a world: the map beside the text, whose names light up on it."""

from __future__ import annotations

import datetime
import getpass
import json
from typing import Any

from nicegui import ui

import rvsg
from rvsg.api.authoring import Description, World, shipped_worlds
from rvsg.api.errors import InputError, RvsgError
from rvsg.api.models import description_of, named_in, store_description
from rvsg.studio.answers import world_place
from rvsg.studio.frame import Page, field, load, page, problem, tag
from rvsg.studio.workspace import Workspace

PARTS = {"layout": "Layout", "grid": "Grid"}


def add(workspace: Workspace) -> None:
    """Add the page."""

    @ui.page("/describe", response_timeout=60)
    async def describe(world: str = "") -> None:
        try:
            place = world_place(workspace, {"world": world})
            loaded = await load(rvsg.load_world, place)
            found = await load(description_of, loaded)
        except RvsgError as error:
            problem(workspace, "Description", error)
            return
        with page(workspace, f"Description of {loaded.title}", wide=True) as made:
            Review(made, world, loaded, found)


class Review:
    """The text of a description and what a person decides on it."""

    def __init__(self, made: Page, name: str, world: World, found: Description | None) -> None:
        self.page, self.name, self.world = made, name, world
        self.found = found or Description(layout="", grid="")
        self.texts = {key: getattr(self.found, key) for key in PARTS}
        self.before: dict[str, str] = dict(self.texts)
        made.command("Let a model write it", f"rvsg describe {name} --model PROVIDER:NAME")
        made.command("Review it", f"rvsg describe {name} --review")
        self.state = tag("p", self._said(), cls="soft")
        if found is None:
            tag("p", "Nobody has described this world yet. Let a model write it, or write it yourself.")
        with tag("div", cls="st-two"):
            tag("div", data_studio="named", data_world=name, id="named-map")
            with tag("section", aria_label="Text"):
                for key, title in PARTS.items():
                    tag("h2", title)
                    self._shown(key)
        with tag("section", aria_label="Edit"):
            tag("h2", "Edit")
            for key, title in PARTS.items():
                with field(title):
                    text = tag("textarea", self.texts[key], rows=6, maxlength=6000)
                    text.on("input", lambda event, key=key: self._typed(key, str(event.args)),
                            js_handler="(e) => emit(e.target.value)")  # fmt: skip
            self.reason = ""
            with tag("p", cls="st-actions"):
                made.button("Accept", lambda: self._store(reviewed=True), cls="st-primary")
                made.button("Save without accepting", lambda: self._store(reviewed=False))
            with field("Reason", help="What is wrong with it; kept for the model that revises it"):
                text = tag("textarea", "", rows=2, maxlength=2000)
                text.on("input", lambda event: setattr(self, "reason", str(event.args)),
                        js_handler="(e) => emit(e.target.value)")  # fmt: skip
            made.button("Reject", self._reject, cls="st-danger")

    def _shown(self, key: str) -> None:
        """Show a text with its names as buttons that light up on the map; unknown ones are marked."""
        with tag("p", cls="reasoning"):
            for piece, kind in named_in(self.texts[key], self.world):
                if kind == "text":
                    tag("span", piece)
                elif kind == "unknown":
                    tag("mark", piece, cls="st-unknown", title="There is nothing of this name in the world")
                else:
                    tag("button", piece, cls="st-named", type="button", data_name=piece)

    def _said(self) -> str:
        if not self.found.reviewed:
            return "Not reviewed."
        return f"Reviewed by {self.found.reviewer or 'somebody'} on {self.found.reviewed_on or 'an unknown day'}."

    def _typed(self, key: str, text: str) -> None:
        self.texts[key] = text

    async def _store(self, *, reviewed: bool) -> None:
        texts = {key: " ".join(text.split()) for key, text in self.texts.items()}
        if not all(texts.values()):
            raise InputError("Layout and grid both need a text.")
        told: dict[str, Any] = {"reviewed": reviewed}
        if reviewed:
            told |= {"reviewer": getpass.getuser(), "reviewed_on": datetime.date.today().isoformat()}
        made = Description(**texts, **told)
        place = None if self.name in shipped_worlds() else self.page.workspace.existing(self.name)
        path = await load(store_description, self.world, made, place)
        self.found = made
        self.state.set_text(self._said())
        self.page.say(f"Stored in {path}.")

    async def _reject(self) -> None:
        if not self.reason.strip():
            raise InputError("Say what is wrong with it.")
        await self._store(reviewed=False)
        kept = self.page.workspace.own / "rejected.json"
        kept.write_text(json.dumps({"world": self.name, "reason": self.reason.strip()}), encoding="utf-8")
        self.page.say(
            "Rejected. Give the reason to a model with: "
            f"rvsg describe {self.name} --model PROVIDER:NAME --review (answer r). The reason: {self.reason.strip()}"
        )
