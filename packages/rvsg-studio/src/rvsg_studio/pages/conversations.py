"""Conversations: what a model was asked and answered, what it cost, and what the checker said."""

from __future__ import annotations

from typing import Any

from nicegui import ui

import rvsg
from rvsg.core.errors import RvsgError
from rvsg.evaluation.wording import counted
from rvsg_studio.frame import PATIENT_S, Page, address, chip, field, link, load, page, problem, tag, text_input
from rvsg_studio.transcripts import Conversation, Turn, conversations_of
from rvsg_studio.workspace import Workspace

SHOWN = 60
LONGEST = 20_000


def add(workspace: Workspace) -> None:
    """Add the page."""

    @ui.page("/conversations", response_timeout=PATIENT_S)
    async def conversations(folder: str = "", name: str = "") -> None:
        if not folder:
            await _list(workspace)
            return
        try:
            path = workspace.existing(folder)
            found = await load(_read, workspace, folder, name)
        except RvsgError as error:
            problem(workspace, "Conversations", error)
            return
        with page(workspace, f"Conversations of {workspace.relative(path)}") as made:
            Search(made, folder, name, found)


def _read(workspace: Workspace, folder: str, name: str) -> tuple[Conversation, ...]:
    path = workspace.existing(folder)
    found: tuple[Conversation, ...] = workspace.kept(
        ("conversations", folder, name), path, lambda: conversations_of(rvsg.Campaign.open(path, name or None))
    )
    return found


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


class Search:
    """The conversations of a campaign that hold the words that are searched for."""

    def __init__(self, made: Page, folder: str, name: str, found: tuple[Conversation, ...]) -> None:
        self.page, self.folder, self.name, self.found = made, folder, name, found
        with field("Search", help="In reasoning, questions, answers and findings of the checker"):
            text_input("", self._search, kind="search", autocomplete="off")
        self.count = tag("p", "", cls="soft", role="status")
        self.list = tag("div")
        self._search("")
        made.command("What a model would be asked next", "rvsg prompt --world WORLD --route ROUTE")

    def _search(self, words: str) -> None:
        shown = [each for each in self.found if not words.strip() or each.holds(words.strip())]
        self.count.set_text(f"{len(shown)} of {counted(len(self.found), 'configuration')}")
        self.list.clear()
        with self.list:
            for each in shown[:SHOWN]:
                self._show(each)
            if len(shown) > SHOWN:
                tag("p", f"and {len(shown) - SHOWN} more: search for what you look for.", cls="soft")

    def _show(self, each: Conversation) -> None:
        cost = "cost unknown" if each.cost_usd is None else f"{each.cost_usd:.4f} USD"
        spent = f"{counted(each.calls, 'call')}, {cost}" if each.calls else each.generator
        with tag("details", cls="thought"):
            with tag("summary"):
                tag("strong", f"Scenario {each.scenario + 1}, configuration {each.configuration + 1}")
                tag("span", f" {spent}, {counted(each.corrections, 'correction')} ", cls="soft small")
                chip("valid" if each.valid else "invalid", good=each.valid, bad=not each.valid)
            _section("Reasoning", [each.reasoning] if each.reasoning else [])
            _section("The checker said of the first answer", each.findings)
            _section("Repaired", each.repairs)
            _section("Left at the end", each.problems)
            for turn in each.turns:
                self._turn(turn)
            if each.valid:
                link("Open the attempt", "/finding", campaign=self.folder, name=self.name, attempt=each.attempt)

    def _turn(self, turn: Turn) -> None:
        with tag("div", cls="st-turn"):
            cost = "" if turn.cost_usd is None else f", {turn.cost_usd:.4f} USD"
            tag("h2", f"{turn.purpose}: {turn.model}", cls="st-minor")
            tokens = f"{turn.input_tokens} tokens in, {turn.output_tokens} out{cost}, {turn.seconds:.1f} s"
            tag("p", tokens, cls="soft small")
            for role, text in turn.given:
                with tag("details"):
                    tag("summary", f"{role}: {text[:90]}")
                    tag("pre", text[:LONGEST], tabindex="0")
            for digest in turn.pictures:
                where = address("/data/picture", campaign=self.folder, name=self.name, digest=digest)
                tag("img", src=where, alt="What the model was shown", loading="lazy", cls="st-shown")
            if turn.lost_pictures:
                said = f"{counted(turn.lost_pictures, 'picture')} that the model was shown, not kept with this record"
                tag("p", said, cls="soft small")
            if turn.answer:
                tag("pre", turn.answer[:LONGEST], tabindex="0")
            if turn.error:
                tag("p", turn.error, cls="st-wrong")


def _section(title: str, lines: Any) -> None:
    if not lines:
        return
    tag("h2", title, cls="st-minor")
    for line in lines:
        tag("p", line, cls="reasoning small")
