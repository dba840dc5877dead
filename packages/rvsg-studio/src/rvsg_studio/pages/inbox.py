"""Proposals: scenarios that a generator wrote, what the checker says of each, and what a person makes of them."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from nicegui import ui

import rvsg
from rvsg.core.errors import InputError, RvsgError
from rvsg.evaluation.verdict import counted
from rvsg.generation.generator import Proposal, read_proposal
from rvsg.scenario.builder import load_scenario_in, save_scenario
from rvsg.scenario.requirement import shipped_requirements
from rvsg.world.world_folder import shipped_worlds
from rvsg_studio.frame import Page, actions, chip, field, link, load, number_input, page, route, select, tag
from rvsg_studio.model_questions import asked_model
from rvsg_studio.pages.describe import model_form
from rvsg_studio.pages.new_campaign import generators, routes_of
from rvsg_studio.workspace import Job, Typed, Workspace

FOLDER = "proposals"
"""Where the proposals lie, in the folder of the studio."""
TARGET = "proposals"
ASKED = {"world": "warehouse", "route": "route_1", "requirement": "R1", "generator": "heuristic",
         "humans": 2, "seed": 0, "count": 3}  # fmt: skip
"""What is asked for until somebody chooses otherwise."""
MOST = 100
SHOWN = 100


@dataclass(frozen=True)
class InboxEntry:
    """A proposal in the inbox. `wrong` says why it cannot be read, or what the checker finds in it now."""

    path: Path
    proposal: Proposal | None
    wrong: tuple[str, ...]

    @property
    def valid(self) -> bool:
        """Whether it can be simulated as it is."""
        return self.proposal is not None and self.proposal.scenario is not None and not self.wrong


def add(workspace: Workspace) -> None:
    """Add the page."""

    @route(workspace, "/inbox", "Proposals", menu=3)
    async def inbox() -> None:
        entries = await load(proposals, workspace)
        listing = await load(workspace.listing)
        with page(workspace, "Proposals", here="/inbox") as view:
            Inbox(view, entries, (*shipped_worlds(), *listing.worlds))


def proposals(workspace: Workspace) -> list[InboxEntry]:
    """Return the proposals of the folder, the newest first, each with what the checker says of it."""
    folder = workspace.path(FOLDER)
    paths = sorted(folder.glob("*.json"), key=lambda path: -path.stat().st_mtime_ns) if folder.is_dir() else []
    return [workspace.cached(("proposal", str(path)), path, partial(read, path)) for path in paths[:SHOWN]]


def read(path: Path) -> InboxEntry:
    """Read a proposal and check its scenario."""
    try:
        proposal = read_proposal(path)
        if proposal.scenario is None:
            return InboxEntry(path, proposal, ())
        scenario, world = load_scenario_in(path)
        return InboxEntry(path, proposal, tuple(str(finding) for finding in rvsg.check(scenario, world)))
    except RvsgError as error:
        return InboxEntry(path, None, (str(error),))


class Inbox:
    """The list, and the form that asks for more."""

    def __init__(self, view: Page, entries: list[InboxEntry], worlds: tuple[str, ...]) -> None:
        self.page, self.workspace, self.entries = view, view.workspace, entries
        self.typed = Typed(self.workspace, "inbox")
        self.asked: dict[str, Any] = {**ASKED, **self.typed.fields}
        tag("p", "A generator writes scenarios; you open, accept or drop each. They lie in proposals/ as files.")
        with tag("details", cls="st-ask", open=not entries):
            tag("summary", "Ask for proposals")
            self.fields = tag("div", cls="st-form")
            self._fields(worlds)
            tag("p", "For a vision language model:", cls="soft small")
            model_form(view.workspace)
            with actions():
                view.button("Ask", self._ask, cls="st-primary")
        self.news = tag("p", "", cls="st-news soft small", role="status")
        self.list = tag("div")
        view.command("Ask for a proposal", f"rvsg scenario propose --seed 0 --out {FOLDER}/NAME.json")
        view.command("Try it", f"rvsg simulate {FOLDER}/NAME.json")
        self._show()
        self.timer = ui.timer(1.0, view.guarded(self._follow))

    def _fields(self, worlds: tuple[str, ...]) -> None:
        self.fields.clear()
        asked = self.asked
        with self.fields:
            with field("World"):
                select(worlds, asked["world"], lambda name: self._choose_world(name, worlds))
            with field("Route"):
                select(routes_of(asked["world"]), asked["route"], partial(self._set, "route"))
            with field("Requirement"):
                options = {name: f"{name}: {requirement.title}" for name, requirement in shipped_requirements().items()}
                select(options, asked["requirement"], partial(self._set, "requirement"))
            with field("Who writes it"):
                select(generators(), asked["generator"], partial(self._set, "generator"))
            for key, label in (("humans", "People"), ("seed", "First seed"), ("count", "How many")):
                with field(label):
                    number_input(asked[key], partial(self._set, key), inputmode="numeric")

    def _set(self, key: str, value: Any) -> None:
        value = 0 if value is None else value  # an empty number
        self.asked[key] = value
        self.typed.keep({key: value})

    def _choose_world(self, name: str, worlds: tuple[str, ...]) -> None:
        self._set("world", name)
        self._set("route", next(iter(routes_of(name)), ""))
        self._fields(worlds)

    def _ask(self) -> None:
        asked = dict(self.asked)
        count = asked.pop("count")
        if not 1 <= count <= MOST:
            raise InputError(f"Ask for 1 to {MOST} proposals at a time.")
        options = " ".join(f"--{key} {shlex.quote(str(value))}" for key, value in asked.items())
        if asked["generator"] == "vlm":
            model = asked_model(self.workspace)
            asked |= model.arguments
            options += f" {model.options}"
        command = f"rvsg scenario propose {options} --out {FOLDER}/NAME.json"
        self.workspace.jobs.start("propose", title="Proposals", command=command, target=TARGET, folder=FOLDER,
                                  settings=asked, count=count)  # fmt: skip
        self.page.command("Ask for these", command)

    async def _follow(self) -> None:
        job: Job | None = await load(self.workspace.jobs.of, TARGET)
        if job is not None:
            said = job.result.get("reason", "")
            self.news.set_text("Proposals are being written…" if job.running else said)
        entries = await load(proposals, self.workspace)
        if entries != self.entries:
            self.entries = entries
            self._show()

    def _show(self) -> None:
        self.list.clear()
        with self.list:
            if not self.entries:
                tag("p", "No proposal is in the inbox.", cls="soft")
            for entry in self.entries:
                self._one(entry)

    def _one(self, entry: InboxEntry) -> None:
        name, proposal = entry.path.stem, entry.proposal
        file = self.workspace.relative(entry.path)
        with tag("section", cls="st-card st-proposal", aria_label=name):
            with tag("p", cls="st-card-head"):
                chip("valid", "good") if entry.valid else chip("invalid", "bad")
                tag("strong", name)
                if proposal is not None:
                    spent = f", {counted(len(proposal.calls), 'call')}" if proposal.calls else ""
                    tag("span", f"{proposal.generator}{spent}", cls="soft small")
            if proposal is not None and proposal.scenario is not None:
                tag("p", proposal.scenario.description or "Without a description", cls="st-clip")
            _verdict(entry)
            with actions():
                if entry.valid:
                    link("Open in the editor", "/scenario", cls="st-button", file=file)
                    self.page.button("Accept", lambda: self._accept(entry), aria_label=f"Accept {name}")
                self.page.button("Drop", lambda: self._drop(entry), cls="st-danger", aria_label=f"Drop {name}")

    def _accept(self, entry: InboxEntry) -> None:
        """Save the scenario of a proposal with the others, and take it out of the inbox."""
        target = self.workspace.path(f"scenarios/{entry.path.name}")
        if target.exists():
            where = self.workspace.relative(target)
            raise InputError(f"{where} exists already. Open the proposal to save it under another name.")
        scenario, _ = load_scenario_in(entry.path)
        save_scenario(scenario, target)
        self._take_out(entry)
        self.page.say(f"Kept as {self.workspace.relative(target)}.")

    def _drop(self, entry: InboxEntry) -> None:
        self._take_out(entry)
        self.page.say(f"Dropped. It still lies in {FOLDER}/dropped.")

    def _take_out(self, entry: InboxEntry) -> None:
        out = entry.path.parent / "dropped"
        out.mkdir(exist_ok=True)
        entry.path.replace(out / entry.path.name)
        self.entries = [other for other in self.entries if other.path != entry.path]
        self._show()


def _verdict(entry: InboxEntry) -> None:
    """Lay out what the checker says: of the first answer, what was repaired, and what is left."""
    said: dict[str, tuple[object, ...]] = {"Left": entry.wrong}
    if (proposal := entry.proposal) is not None:
        said["Left"] = (*proposal.problems, *entry.wrong)
        said["In the first answer"] = proposal.first_findings
        said["Repaired"] = tuple(f"{r.human}, {r.task}: {r.what}" for r in proposal.repairs)
    if not any(said.values()):
        tag("p", "The checker finds nothing.", cls="soft small")
    for title, lines in said.items():
        if not lines:
            continue
        with tag("details", open=title == "Left"):
            tag("summary", f"{title}: {counted(len(lines), 'finding' if title != 'Repaired' else 'repair')}")
            with tag("ul", cls="small"):
                for line in lines[:SHOWN]:
                    tag("li", str(line))
