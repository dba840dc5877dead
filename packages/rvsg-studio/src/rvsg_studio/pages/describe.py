"""Texts that a model wrote: the description of a world beside its map, and the conversations of a campaign."""

from __future__ import annotations

import datetime
import getpass
import shlex
from functools import partial
from typing import Any

from nicegui import ui

import rvsg
from rvsg.core.errors import InputError
from rvsg.evaluation.verdict import counted
from rvsg.generation.environment import store_description
from rvsg.world.world import Description
from rvsg_studio.frame import (
    PATIENT_S,
    Page,
    actions,
    address,
    as_script,
    field,
    link,
    load,
    number_input,
    page,
    route,
    section,
    svg,
    tag,
    text_area,
    text_input,
)
from rvsg_studio.model_questions import (
    PARTS,
    Review,
    Texts,
    asked_model,
    conversation_of,
    difference,
    keep_model,
    named_in,
)
from rvsg_studio.workspace import Job, Workspace


def add(workspace: Workspace) -> None:
    """Add the pages."""

    @route(workspace, "/describe", "Description")
    async def describe(world: str = "") -> None:
        review = await load(Review, workspace, world)
        with page(workspace, f"Description of {review.world.title}", wide=True) as view:
            Reviewing(view, review)

    @route(workspace, "/conversations", "Conversations", menu=5, patience_s=PATIENT_S)
    async def conversations(folder: str = "", name: str = "") -> None:
        if not folder:
            await _list(workspace)
            return
        shown = await load(_read, workspace, folder, name)
        with page(workspace, f"Conversations of {workspace.relative(workspace.existing(folder))}", wide=True) as view:
            tag("div", data_studio="filter", data_of=".step", data_within=".thought", data_counted="configurations")
            with section("How the configurations came to be", "conversation"):
                svg(shown)
            view.command("What a model would be asked next", "rvsg scenario prompt --world WORLD --route ROUTE")


class Reviewing:
    """The page: the map, the text with its names, the difference after a revision, and what a person decides."""

    def __init__(self, view: Page, review: Review) -> None:
        self.page, self.review = view, review
        name = shlex.quote(review.name)
        model = asked_model(view.workspace).options
        view.command("Let a model write it", f"rvsg world describe {name} {model}")
        view.command("Reject with a reason", f"rvsg world describe {name} {model} --review (answer r)")
        view.command("Accept, edit", f"rvsg world describe {name} --review")
        self.state = tag("p", self._said(), cls="soft")
        self.news = tag("p", "", cls="st-news soft small", role="status")
        with tag("div", cls="st-two"):
            tag("div", data_studio="named", data_world=review.name, id="named-map")
            self.shown = tag("section", aria_label="Text")
        self._edit()
        self._decide()
        self._show()
        if (job := review.job) is not None:
            self._follow(job)
        self.timer = ui.timer(1.0, view.guarded(self._watch))

    def _edit(self) -> None:
        with tag("section", aria_label="Edit"):
            tag("h2", "Edit")
            for key, title in PARTS.items():
                with field(title):
                    text = getattr(self.review.draft.texts, key)
                    text_area(text, partial(self._typed, key), rows=6, maxlength=6000, id=f"text-{key}")
            with actions():
                self.page.button("Accept", lambda: self._store(reviewed=True), cls="st-primary")
                self.page.button("Save without accepting", lambda: self._store(reviewed=False))
                self.page.button("Forget what is not saved", self._forget)

    def _decide(self) -> None:
        with tag("section", aria_label="Ask a model"):
            tag("h2", "Reject, or let a model write it")
            model_form(self.page.workspace)
            with field("Reason", help="What is wrong with the text. The model sees it with the text and the pictures."):
                typed = lambda text: self.review.change(reason=text)  # noqa: E731
                text_area(self.review.draft.reason, typed, rows=2, maxlength=2000, id="reason")
            with actions():
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
                with tag("p", cls="reasoning"):
                    for piece, kind in named_in(getattr(draft.texts, key), self.review.world):
                        if kind == "text":
                            tag("span", piece)
                        elif kind == "unknown":
                            tag("mark", piece, cls="st-unknown", title="There is nothing of this name in the world")
                        else:
                            tag("button", piece, cls="st-named", type="button", data_name=piece)
            if draft.before is not None and draft.before.whole and draft.before != draft.texts:
                self._difference(draft.before, draft.texts, draft.reasons)

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
        facts: dict[str, Any] = {"reviewed": reviewed}
        if reviewed:
            facts |= {"reviewer": getpass.getuser(), "reviewed_on": datetime.date.today().isoformat()}
        description = Description(**texts, **facts)
        path = await load(store_description, self.review.world, description, self.review.place)
        self.review.accept(description)
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
        command = f"rvsg world describe {shlex.quote(self.review.name)} {asked.options}{' --review' if reason else ''}"
        begun = self.review.begin(reason)
        job = self.page.workspace.jobs.start("describe", title="Description", command=command,
                                             target=self.review.target, **begun, access=model)  # fmt: skip
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


def model_form(workspace: Workspace) -> None:
    """Lay out the fields that name a model; what is typed is kept at once."""
    asked = asked_model(workspace)
    with tag("div", cls="st-form"):
        with field("Model", help="PROVIDER:NAME; its key is read from the environment."):
            text_input(asked.model, lambda text: keep_model(workspace, model=text), autocomplete="off")
        with field("Server", help="Only for an OpenAI-compatible server of your own"):
            text_input(asked.base_url, lambda text: keep_model(workspace, base_url=text), autocomplete="off")
        with field("Budget in USD", help="It stops before its calls cost more."):
            number_input(asked.budget_usd, lambda usd: keep_model(workspace, budget_usd=usd), float, step="any")


def _read(workspace: Workspace, folder: str, name: str) -> str:
    path, where = workspace.existing(folder), {"campaign": folder, "name": name or None}
    return workspace.cached(
        ("conversations", folder, name),
        path,
        lambda: conversation_of(
            rvsg.Campaign.open(path, name or None),
            lambda digest: address("/data/picture", **where, digest=digest),
            lambda attempt: address("/finding", **where, attempt=attempt),
        ),
    )


async def _list(workspace: Workspace) -> None:
    listing = await load(workspace.listing)
    with page(workspace, "Conversations", here="/conversations"):
        tag("p", "Every campaign keeps how its scenarios came to be. Those of a model hold what it was asked.")
        with tag("ul", cls="st-list"):
            for campaign in listing.campaigns:
                if campaign.problem:
                    continue
                with tag("li"):
                    link(campaign.folder, "/conversations", folder=campaign.folder, name=campaign.name or None)
                    if not campaign.name:
                        continue
                    calls = f"{counted(campaign.calls, 'call')} of {campaign.model}" if campaign.calls else "no model"
                    tag("span", f" {campaign.generator}, {calls}", cls="soft small")
        if not listing.campaigns:
            tag("p", "No campaign lies in this folder.", cls="soft")
