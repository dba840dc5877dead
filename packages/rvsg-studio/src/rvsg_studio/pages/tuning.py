"""Tuning of a stack on a suite or a finding: the form, the front while it is searched, and what comes of it."""

from __future__ import annotations

import contextlib
import shlex
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from nicegui import ui

import rvsg
from rvsg.app.settings import safe_name
from rvsg.core.errors import InputError, RvsgError
from rvsg.simulation.stacks.stack_choice import DEFAULT_STACK, StackChoice, stack_names
from rvsg.tune.tuner import PAGE, check_budget
from rvsg.tune.tuning import Tuning
from rvsg.tune.tuning_page import front_row, headline, result_lines
from rvsg_studio.answers import tuning_in
from rvsg_studio.frame import (
    Page,
    actions,
    address,
    chip,
    field,
    link,
    load,
    page,
    route,
    section,
    table,
    tag,
    text_input,
)
from rvsg_studio.listing import Failure, Listing
from rvsg_studio.pages.finding import JobLine, job_buttons
from rvsg_studio.pages.home import add_to_suite
from rvsg_studio.workspace import Job, Typed, Workspace

FIELDS = {
    "suite": ("Suite", "A folder of the studio with cases that fail", "suite"),
    "stack": ("Stack", "A name, your nav2_params.yaml, file.py:Class or exec:COMMAND", DEFAULT_STACK),
    "budget_runs": ("Runs of the search", "At most; checks come on top", "3000"),
    "budget_minutes": ("Minutes of the search", "Ends it earlier; empty: the runs alone decide", ""),
    "attack_runs": ("Runs of each attack", "New searches against the stack before and after; 0: none", "150"),
    "out": ("Folder", "Of the tuning; the same one resumes. Empty: named after suite and stack", ""),
}
WHAT = (
    "Searches parameters of the stack that fail less on the suite, and checks them on held-out cases, other traffic, "
    "empty routes and new attacks."
)
Values = Mapping[str, Any]
FRONT = ("Setting", "What it trades", "Violations", "Contact", "Time", "")


def add(workspace: Workspace) -> None:
    """Add the pages."""

    @route(workspace, "/tune", "Tune a stack")
    async def tune(suite: str = "", campaign: str = "", attempt: int = -1) -> None:
        listing = await load(workspace.whole_listing if campaign else workspace.listing)
        failure = next((entry for entry in listing.failures if _is(entry, campaign, attempt)), None)
        if campaign and failure is None:
            raise InputError(f"Attempt {attempt} of {campaign} is no confirmed failure. Confirm it first.")
        with page(workspace, "Tune a stack") as view:
            TuningForm(view, listing, suite, failure)

    @route(workspace, "/tuning", "Tuning")
    async def tuning(folder: str = "") -> None:
        folder = workspace.relative(workspace.path(folder))
        job, result = await load(workspace.jobs.of, folder), await load(tuning_in, workspace, folder)
        if job is None and result is None:
            raise InputError(f"{folder}: there is no tuning here.")
        with page(workspace, f"Tuning in {folder}", wide=True) as view:
            if job is not None:
                _follow(view, job)
            if result is not None and not (job is not None and job.running):
                _result(view, folder, result, job)


def _is(failure: Failure, campaign: str, attempt: int) -> bool:
    return failure[0].folder == campaign and attempt in (failure[1].row.attempt, failure[1].row.confirmation)


class TuningForm:
    """What a tuning is started with. What is typed is kept."""

    def __init__(self, view: Page, listing: Listing, suite: str, failure: Failure | None) -> None:
        self.page, self.failure, self.typed = view, failure, Typed(view.workspace, "tune")
        self.asked = {key: default for key, (_, _, default) in FIELDS.items()} | self.typed.fields
        self.asked |= {"suite": suite} if suite else {}
        self.wrong: dict[str, Any] = {}
        tag("p", WHAT)
        if failure is not None:
            tag("p", f"The finding is first kept as a case of the suite: {failure[1].row.name}.")
        for key, names in (("suite", listing.suites), ("stack", stack_names())):
            with tag("datalist", id=f"known-{key}"):
                for name in names:
                    tag("option", value=name)
        with tag("div", cls="st-form"):
            for key, (label, help, _) in FIELDS.items():
                with tag("div"):
                    with field(label, help=help):
                        text_input(self.asked[key], partial(self._set, key), id=key, autocomplete="off",
                                   list=f"known-{key}", aria_describedby=f"wrong-{key}")  # fmt: skip
                    self.wrong[key] = tag("p", "", cls="st-wrong small", role="alert", id=f"wrong-{key}")
        with actions():
            view.button("Tune", self._start, cls="st-primary")
        view.command("Tune", "rvsg tune suite --stack nav2_params.yaml --out runs/tuned --budget-runs 3000")

    def _set(self, key: str, text: str) -> None:
        self.asked[key] = text
        self.wrong[key].set_text("")
        self.typed.keep({key: text})

    async def _start(self) -> None:
        """Start the tuning, or say beside the first field that cannot be used what is wrong."""
        workspace, values = self.page.workspace, dict[str, Any]()
        for key, read in READ.items():
            try:
                values[key] = await load(read, workspace, self.asked[key].strip(), values, self.failure)
            except RvsgError as error:
                self.wrong[key].set_text(str(error))
                return
        _begin(workspace, values.pop("out"), values)


def _stack(workspace: Workspace, text: str, earlier: Values, failure: Failure | None) -> str:
    if ":" not in text:  # code that a form names is run by the process of its job alone
        StackChoice.of(text).close()
    return text


def _suite(workspace: Workspace, text: str, earlier: Values, failure: Failure | None) -> str:
    name = workspace.relative(workspace.path(text))
    if failure is not None:
        add_to_suite(workspace, [failure], name)
    rvsg.Suite.open(workspace.path(name)).chosen(())
    return name


def _runs(workspace: Workspace, text: str, earlier: Values, failure: Failure | None) -> int:
    runs: int = _number(int, 1, text)
    check_budget(runs, len(rvsg.Suite.open(workspace.path(earlier["suite"])).cases))
    return runs


def _number(kind: type, least: float, text: str) -> Any:
    with contextlib.suppress(ValueError):
        if least <= (number := kind(text)) < 1e9:
            return number
    raise InputError(f"{text or 'Nothing'}: expected a {'whole ' if kind is int else ''}number from {least:g} on.")


def _out(workspace: Workspace, text: str, earlier: Values, failure: Failure | None) -> str:
    name = "-".join(Path(earlier[key]).stem for key in ("suite", "stack"))
    return workspace.relative(workspace.path(text or f"runs/tune-{safe_name(name)}"))


READ: dict[str, Callable[[Workspace, str, Values, Failure | None], Any]] = {
    "stack": _stack,
    "budget_minutes": lambda _, text, *__: _number(float, 0.1, text) if text else None,
    "attack_runs": lambda _, text, *__: _number(int, 0, text),
    "suite": _suite,
    "budget_runs": _runs,
    "out": _out,
}
"""What each field says, in the order of asking: what is kept in a suite comes after what may be wrong alone."""


def _begin(workspace: Workspace, folder: str, arguments: Mapping[str, Any]) -> None:
    """Start the job, also one that resumes or that takes another setting, and show it."""
    options = {f"--{key.replace('_', '-')}": str(value) for key, value in arguments.items() if value not in (None, "")}
    suite = options.pop("--suite")
    words = [word for pair in options.items() for word in pair]
    command = shlex.join(["rvsg", "tune", suite, *words, "--out", folder])
    workspace.jobs.start("tuning", title="Tuning", command=command, target=folder, **arguments)
    ui.navigate.to(address("/tuning", folder=folder))


def _follow(view: Page, job: Job) -> None:
    """Lay out the job, and the front so far while it is searched."""
    view.command(job.title, job.command)
    with tag("ul", cls="st-list"):
        JobLine(view, job)
    with actions():
        if job.running:
            job_buttons(view, job, view.say)
        elif job.state != "finished":
            view.button("Resume", partial(_begin, view.workspace, job.target, job.arguments), cls="st-primary")
            link("Change the settings", "/tune", cls="st-button", suite=job.arguments["suite"])
    if not job.running:
        return
    with section("The front so far", "front"):
        rows = tag("div")
    at = [0]

    async def follow() -> None:
        events, at[0] = await load(view.workspace.jobs.events, job.id, at[0])
        fronts = [event["rows"] for event in events if event["kind"] == "front"]
        if fronts:
            rows.clear()
            with rows:
                _front(fronts[-1])
        if not (await load(view.workspace.jobs.get, job.id)).running:
            timer.deactivate()
            ui.navigate.reload()

    timer = ui.timer(1.0, view.guarded(follow))


def _front(rows: Iterable[Mapping[str, Any]], lay: Callable[[int], None] = lambda number: None) -> None:
    """Lay out the settings of a front; `lay` adds what can be done with one."""
    with table(FRONT, label="Front"):
        for row in rows:
            with tag("tr"):
                for key in ("number", "trade", "violated", "contact", "time"):
                    tag("td", str(row[key]), cls="" if key == "trade" else "n")
                with tag("td"):
                    lay(row["number"])


def _result(view: Page, folder: str, result: Tuning, job: Job | None) -> None:
    """Lay out what came of it, in the words of its page."""
    with tag("p"):
        tag("strong", headline(result))
    with actions():
        if result.file:
            saved = address("/data/tuned", folder=folder)
            tag("a", f"Save {result.file}", cls="st-button st-primary", href=saved, download=result.file)
        tag("a", f"Open {PAGE}", cls="st-button", href=address("/data/tuning", folder=folder), target="_blank")
    with tag("ul", cls="small"):
        for line in result_lines(result):
            tag("li", line)

    def choose(number: int) -> None:
        if number == result.proposal:
            chip("proposed", "good")
        elif number and job is not None:
            again = partial(_begin, view.workspace, folder, {**job.arguments, "choose": number})
            view.button("Propose this", again, aria_label=f"Propose setting {number}")

    with section("Settings to choose from", "front"):
        _front([front_row(setting.number, setting.score, result.before) for setting in result.front], choose)
    for command in result.commands:
        view.command("Next", command)
