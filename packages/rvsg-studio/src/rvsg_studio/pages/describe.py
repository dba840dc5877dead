"""Review what a model wrote of a world: the map beside the text, whose names light up on it."""

from __future__ import annotations

import datetime
import getpass
import shlex
from typing import Any

from nicegui import ui

from rvsg.core.errors import InputError, RvsgError
from rvsg.generation.environment import store_description
from rvsg.world.world import Description
from rvsg_studio.asked_model import asked_model, model_form
from rvsg_studio.frame import Page, as_script, field, load, page, problem, tag
from rvsg_studio.jobs import Job
from rvsg_studio.review import PARTS, Review, Texts
from rvsg_studio.text_pieces import difference, named_in
from rvsg_studio.workspace import Workspace


def add(workspace: Workspace) -> None:
    """Add the page."""

    @ui.page("/describe", response_timeout=60)
    async def describe(world: str = "") -> None:
        try:
            review = await load(Review, workspace, world)
        except RvsgError as error:
            problem(workspace, "Description", error)
            return
        with page(workspace, f"Description of {review.world.title}", wide=True) as made:
            Reviewing(made, review)


class Reviewing:
    """The page: the map, the text with its names, the difference after a revision, and what a person decides."""

    def __init__(self, made: Page, review: Review) -> None:
        self.page, self.review = made, review
        self.inputs: dict[str, Any] = {}
        name = shlex.quote(review.name)
        model = asked_model(made.workspace).options
        made.command("Let a model write it", f"rvsg describe {name} {model}")
        made.command("Reject with a reason", f"rvsg describe {name} {model} --review (answer r)")
        made.command("Accept, edit", f"rvsg describe {name} --review")
        self.state = tag("p", self._said(), cls="soft")
        self.news = tag("p", "", cls="st-news soft small", role="status")
        with tag("div", cls="st-two"):
            tag("div", data_studio="named", data_world=review.name, id="named-map")
            self.shown = tag("section", aria_label="Text")
        self._edit()
        self._decide()
        self._show()
        job = review.job
        if job is not None:
            self._follow(job)
        self.timer = ui.timer(1.0, made.guarded(self._watch))

    def _edit(self) -> None:
        with tag("section", aria_label="Edit"):
            tag("h2", "Edit")
            for key, title in PARTS.items():
                with field(title):
                    text = tag("textarea", getattr(self.review.draft.texts, key), rows=6, maxlength=6000,
                               id=f"text-{key}")  # fmt: skip
                    text.on("input", lambda event, key=key: self._typed(key, str(event.args)),
                            js_handler="(e) => emit(e.target.value)")  # fmt: skip
            with tag("p", cls="st-actions"):
                self.page.button("Accept", lambda: self._store(reviewed=True), cls="st-primary")
                self.page.button("Save without accepting", lambda: self._store(reviewed=False))
                self.page.button("Forget what is not saved", self._forget)

    def _decide(self) -> None:
        with tag("section", aria_label="Ask a model"):
            tag("h2", "Reject, or let a model write it")
            model_form(self.page.workspace)
            with field("Reason", help="What is wrong with the text. The model sees it with the text and the pictures."):
                self.reason = tag("textarea", self.review.draft.reason, rows=2, maxlength=2000, id="reason")
                self.reason.on("input", lambda event: self.review.change(reason=str(event.args)),
                               js_handler="(e) => emit(e.target.value)")  # fmt: skip
            with tag("p", cls="st-actions"):
                self.page.button("Reject", self._reject, cls="st-danger")
                self.page.button("Let a model write it", lambda: self._ask(""))

    def _show(self) -> None:
        """Show the texts with names as buttons that light up on the map, and what a revision changed."""
        draft = self.review.draft
        self.shown.clear()
        with self.shown:
            if not draft.texts.whole:
                tag("p", "Nobody has described this world yet. Let a model write it, or write it yourself.")
            for key, title in PARTS.items():
                tag("h2", title)
                self._named(getattr(draft.texts, key))
            if draft.before is not None and draft.before.whole and draft.before != draft.texts:
                self._difference(draft.before, draft.texts, draft.reasons)

    def _named(self, text: str) -> None:
        with tag("p", cls="reasoning"):
            for piece, kind in named_in(text, self.review.world):
                if kind == "text":
                    tag("span", piece)
                elif kind == "unknown":
                    tag("mark", piece, cls="st-unknown", title="There is nothing of this name in the world")
                else:
                    tag("button", piece, cls="st-named", type="button", data_name=piece)

    def _difference(self, before: Texts, after: Texts, reasons: tuple[str, ...]) -> None:
        with tag("div", id="difference"):
            tag("h2", "Changed since the rejected text")
            if reasons:
                tag("p", f"Reason: {reasons[-1]}", cls="soft")
            for key, title in PARTS.items():
                tag("h3", title)
                with tag("p", cls="reasoning"):
                    for kind, piece in difference(getattr(before, key), getattr(after, key)):
                        tag({"same": "span", "removed": "del", "added": "ins"}[kind], piece)

    def _said(self) -> str:
        stored = self.review.stored
        if stored is None or not stored.reviewed:
            return "Not reviewed."
        return f"Reviewed by {stored.reviewer or 'somebody'} on {stored.reviewed_on or 'an unknown day'}."

    def _typed(self, key: str, text: str) -> None:
        self.review.type(key, text)
        self._show()

    async def _store(self, *, reviewed: bool) -> None:
        texts = {key: " ".join(text.split()) for key, text in self.review.draft.texts.model_dump().items()}
        if not all(texts.values()):
            raise InputError("Layout and grid both need a text.")
        told: dict[str, Any] = {"reviewed": reviewed}
        if reviewed:
            told |= {"reviewer": getpass.getuser(), "reviewed_on": datetime.date.today().isoformat()}
        made = Description(**texts, **told)
        path = await load(store_description, self.review.world, made, self.review.place)
        self.review.accept(made)
        self.state.set_text(self._said())
        self._show()
        self.page.say(f"Stored in {path}.")

    def _forget(self) -> None:
        self.review.forget()
        self._fill()
        self._show()

    def _reject(self) -> None:
        reason = self.review.draft.reason.strip()
        if not reason:
            raise InputError("Say what is wrong with it.")
        if not self.review.draft.texts.whole:
            raise InputError("There is no text to reject. Let a model write one.")
        self._ask(reason)

    def _ask(self, reason: str) -> None:
        """Give the reason to the model; it is kept whatever comes of the call."""
        asked = asked_model(self.page.workspace)
        model = asked.arguments
        command = f"rvsg describe {shlex.quote(self.review.name)} {asked.options}{' --review' if reason else ''}"
        told = self.review.begin(reason)
        job = self.page.workspace.jobs.start("describe", title="Description", command=command,
                                             target=self.review.target, **told, access=model)  # fmt: skip
        self._follow(job)

    async def _watch(self) -> None:
        job = await load(lambda: self.review.job)
        if job is not None:
            self._follow(job)

    def _follow(self, job: Job) -> None:
        """Show how the newest job stands, and take in what it wrote."""
        if job.running:
            self.news.set_text("The model is looking at the pictures…")
        elif job.state == "failed":
            self.news.set_text(job.result.get("reason", ""))
        elif self.review.take(job):
            self.news.set_text(f"The model has written it: {job.result['said']}")
            self._fill()
            self._show()

    def _fill(self) -> None:
        """Put the texts of the draft into the fields, for which the browser keeps its own values."""
        texts = self.review.draft.texts
        fields = {"text-layout": texts.layout, "text-grid": texts.grid, "reason": self.review.draft.reason}
        for name, text in fields.items():
            ui.run_javascript(f"document.getElementById({as_script(name)}).value = {as_script(text)}")
