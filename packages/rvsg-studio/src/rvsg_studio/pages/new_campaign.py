"""A new campaign: the form and the campaign file side by side, with an estimate of time and cost."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import yaml
from nicegui import ui

import rvsg
from rvsg.app.commands import command_for
from rvsg.app.matrix import Matrix
from rvsg.app.proposal import propose
from rvsg.app.settings import (
    BUDGETS,
    LISTED,
    MACHINE,
    CampaignConfig,
    default_of,
    effective,
    parse_campaign_file,
    settings,
    value_type,
)
from rvsg.app.wiring import Wired, jobs_of, wire
from rvsg.core import plugins
from rvsg.core.errors import InputError, RvsgError
from rvsg.core.files import write_whole
from rvsg.core.plugins import ignore
from rvsg.core.records import Record, canonical_json
from rvsg.core.setting import Setting
from rvsg.evaluation.verdict import counted
from rvsg.robots.robot import shipped_robots
from rvsg.scenario.requirement import shipped_requirements
from rvsg.world.world_folder import shipped_worlds
from rvsg_studio.frame import (
    PATIENT_S,
    Page,
    actions,
    address,
    as_script,
    field,
    load,
    number_input,
    page,
    route,
    select,
    tag,
    text_area,
    text_input,
)
from rvsg_studio.listing import FoundCampaign
from rvsg_studio.workspace import Job, Workspace

TRIAL_RUNS, LAST = 2, 5
"""Runs that are tried for an estimate, and campaigns that it is taken from."""


class Estimate(Record):
    """What a campaign will take, at most. None if nothing is known to estimate it from."""

    runs: int
    """Runs of search and confirmation."""
    proposals: int
    least: float
    """Minutes of the search alone."""
    minutes: float
    """Minutes of everything at most: search, confirmation, shrinking."""
    usd: float | None
    run_s: float
    """What one run took here on one core, seconds; the mean of a few."""
    jobs: int
    campaigns: int = 0
    """Finished campaigns of this machine that the time is taken from; 0: the mission was simulated a few times."""
    calls_of: str = ""
    """The model whose calls are part of it."""
    known_calls: int = 0
    """Calls of that model in earlier campaigns, from which time and price of a call are taken."""


def paces(jobs: Iterable[Job], campaigns: Iterable[FoundCampaign], world: str) -> list[float]:
    """Return the seconds for each run of the last campaigns in a world that the studio ran here from begin to end."""
    runs = {c.folder: c.runs for c in campaigns if c.complete and c.runs and c.world == world}
    first = {job.target: job for job in jobs if job.kind == "campaign"}  # the newest first: the oldest of each stays
    done = [job for job in first.values() if job.state == "finished" and job.target in runs]
    return [job.took_s / runs[job.target] for job in done[:LAST]]


def estimate(
    asked: CampaignConfig | Matrix, earlier: Sequence[FoundCampaign] = (), jobs: Sequence[Job] = ()
) -> Estimate:
    """Estimate a campaign by what campaigns and calls of its model took here earlier, else by a few runs.

    Campaigns of a matrix share the workers of one machine.

    Raises:
        InputError: a setting cannot be used.
    """
    if isinstance(asked, Matrix):
        pairs = [asked.settings | dict(zip(LISTED, pair, strict=True)) for pair in asked.pairs]
        return _together([estimate(effective(None, {}, pair), earlier, jobs) for pair in pairs])
    wired = wire(asked)
    plan, cores = wired.plan, jobs_of(asked)
    paced = paces(jobs, earlier, plan.mission.world)
    run_s = cores * sum(paced) / len(paced) if paced else _run_s(wired)
    least, runs_s = plan.search_runs * run_s / cores, (plan.runs + asked.shrink_runs) * run_s / cores
    if asked.generator_name != "vlm" or asked.replay is not None:
        return Estimate(
            runs=plan.runs,
            proposals=plan.attempts,
            least=least / 60,
            minutes=runs_s / 60,
            usd=0.0,
            run_s=run_s,
            jobs=cores,
            campaigns=len(paced),
        )
    model = asked.model or ""
    alike = [campaign for campaign in earlier if campaign.calls and campaign.model == model]
    calls, priced = sum(c.calls for c in alike), [c for c in alike if c.cost_usd is not None]
    call_s = sum(campaign.calls_s for campaign in alike) / calls if calls else 0.0
    paid = sum(campaign.calls for campaign in priced)
    each_usd = sum(campaign.cost_usd or 0.0 for campaign in priced) / paid if paid else None
    return Estimate(
        runs=plan.runs,
        proposals=plan.attempts,
        least=(least + plan.attempts * call_s / plan.max_in_flight) / 60,
        minutes=(runs_s + plan.attempts * call_s / plan.max_in_flight) / 60,
        usd=None if each_usd is None else each_usd * plan.attempts,
        run_s=run_s,
        jobs=cores,
        campaigns=len(paced),
        calls_of=model,
        known_calls=calls,
    )


def _together(estimates: Sequence[Estimate]) -> Estimate:
    """Return the sum of estimates; a run takes their mean."""
    runs, costs = sum(part.runs for part in estimates), [part.usd for part in estimates]
    return estimates[0].replace(
        runs=runs,
        proposals=sum(part.proposals for part in estimates),
        least=sum(part.least for part in estimates),
        minutes=sum(part.minutes for part in estimates),
        run_s=sum(part.run_s * part.runs for part in estimates) / max(1, runs),
        usd=None if None in costs else sum(cost for cost in costs if cost is not None),
    )


_known: dict[str, float] = {}


def _run_s(wired: Wired) -> float:
    """Return the seconds that a run of a scenario of this size takes here."""
    plan, simulator = wired.plan, wired.simulator
    key = canonical_json([plan.mission.id, simulator.name, dict(simulator.options), plan.humans])
    if key not in _known:
        simulator.prepare(ignore)
        proposal = propose(wired.world, plan.mission.route, plan.requirement, humans=plan.humans, seed=0)
        scenario = proposal.scenario
        if scenario is None:
            raise InputError(f"No scenario with {plan.humans} people is found to estimate from; take fewer people.")
        scenario = scenario.replace(mission=plan.mission)
        begun = time.perf_counter()
        for seed in range(TRIAL_RUNS):
            simulator.run(scenario, wired.world, seed=seed)
        _known[key] = (time.perf_counter() - begun) / TRIAL_RUNS
    return _known[key]


GROUPED = {
    "Distance to people": (
        "R1",
        "clearance",
        "personal_space",
        "time_to_collision",
        "slow_near_people",
        "recovers_distance",
    ),
    "Contact": ("no_contact", "any_contact", "contact_speed"),
    "The drive": (
        "R2",
        "R3",
        "arrival",
        "detour",
        "goal_accuracy",
        "stopping",
        "deadlock",
        "emergency_stops",
        "acceleration",
    ),
}
"""Shipped requirements as the form groups them; others come last."""  # fmt: skip
GROUP_OF = {name: group for group, names in GROUPED.items() for name in names}
REQUIREMENTS = {name: shipped_requirements()[name] for name in [*GROUP_OF, *shipped_requirements()]}
DRAFT = "new-campaign.yaml"
HEAD = "# A campaign file: every key is an option of `rvsg run`.\n"
GENERATOR_TITLES = {"heuristic": "heuristic, offline", "vlm": "vision language model"}
"""What the shipped generators are called, where their names do not say it."""
NOT_STORED = ("jobs", *BUDGETS)
"""Settings that are not stored with the campaign, and go to the process that runs it."""


def generators() -> dict[str, str]:
    """Return the installed generators by name, each with its title."""
    return {name: GENERATOR_TITLES.get(name, name) for name in plugins.names("generator")}


class CampaignDraft:
    """The settings of a campaign that is being written; what is typed is on the disk at once."""

    def __init__(self, workspace: Workspace) -> None:
        self.workspace = workspace
        self.path = workspace.own / DRAFT
        self.text = self.path.read_text(encoding="utf-8") if self.path.is_file() else HEAD + "world: warehouse\n"
        self.problem = ""
        self.settings: dict[str, Any] = {}
        self.read()

    def write(self, text: str) -> None:
        """Take a new text of the file."""
        self.text = text
        write_whole(self.path, text)
        self.read()

    def read(self) -> None:
        """Read the text; where it is wrong the settings stay as they were, and `problem` says why."""
        try:
            values = parse_campaign_file(self.text, Path("campaign.yaml"))
            effective(None, {}, _first_of_each(values))
        except RvsgError as error:
            self.problem = str(error)
            return
        self.settings, self.problem = values, ""

    def set(self, key: str, value: Any) -> None:
        """Change one setting in the text; None or the default takes it out."""
        values = dict(self.settings)
        values.pop(key, None)
        if value is not None and value != default_of(key):
            values[key] = value
        if key == "world":
            values = {"world": value, **values}
            values.pop("route", None)
        self.write(HEAD + (yaml.safe_dump(values, sort_keys=False, allow_unicode=True) if values else ""))

    @property
    def asked(self) -> CampaignConfig | Matrix:
        """What the settings ask for: a campaign, or several.

        Raises:
            InputError: the settings are wrong, or the folder holds campaigns with others.
        """
        if self.problem:
            raise InputError(self.problem)
        return Matrix.of(self.settings, {}) or effective(None, {}, _first_of_each(self.settings))


def _first_of_each(values: dict[str, Any]) -> dict[str, Any]:
    """Return settings with the first of several routes and requirements."""
    return {k: v[0] if k in LISTED and isinstance(v, list) and v else v for k, v in values.items()}


def add(workspace: Workspace) -> None:
    """Add the page."""

    @route(workspace, "/campaign/new", "New campaign", menu=2, patience_s=PATIENT_S)
    async def new_campaign(world: str = "") -> None:
        listing = await load(workspace.listing)
        draft = CampaignDraft(workspace)
        if world not in ("", draft.settings.get("world")):
            draft.set("world", world)
        with page(workspace, "New campaign", here="/campaign/new") as view:
            CampaignForm(view, draft, (*shipped_worlds(), *listing.worlds))


class CampaignForm:
    """The form beside the file. Each writes the other."""

    def __init__(self, view: Page, draft: CampaignDraft, worlds: tuple[str, ...]) -> None:
        self.page, self.draft, self.worlds = view, draft, worlds
        with tag("div", cls="st-two"):
            with tag("section", aria_label="Settings"):
                self.fields = tag("div")
            with tag("section", aria_label="Campaign file"):
                with field("campaign.yaml", help="Edit here or in the form. Every option of `rvsg run` is a key."):
                    text_area(draft.text, self._typed, rows=16, spellcheck="false", cls="st-code", id="yaml")
                self.problem = tag("p", draft.problem, cls="st-message st-wrong", role="alert")
                self.estimate = tag("p", "", cls="soft", role="status")
                with actions():
                    view.button("Start", self._start, cls="st-primary")
                    view.button("Estimate time and cost", self._estimate)
                self.command = tag("p", cls="small")
        view.command("Start", "rvsg run campaign.yaml --out runs/NAME")
        self._show()

    def _typed(self, text: str) -> None:
        if text != self.draft.text:  # a browser reports a pasted text once per line
            self.draft.write(text)
            self._show(written=False)

    def _set(self, key: str, value: Any) -> None:
        value = None if value == "" else value
        self.draft.set(key, value)
        self._show(fields=key in ("world", "generator"))

    def _show(self, *, written: bool = True, fields: bool = True) -> None:
        """Show the settings as they are now; the text is left alone while somebody writes in it."""
        self.problem.set_text(self.draft.problem)
        self.estimate.set_text("")
        if written:
            ui.run_javascript(f"document.getElementById('yaml').value = {as_script(self.draft.text)}")
        if fields and not self.draft.problem:
            self.fields.clear()
            with self.fields:
                self._fields()
        self.command.clear()
        with self.command:
            try:
                asked = self.draft.asked
                if isinstance(asked, Matrix):
                    tag("p", f"{len(asked.pairs)} campaigns, one for each route and requirement.")
                    tag("code", asked.commands())
                else:
                    tag("code", command_for(asked, out=asked.folder))
            except RvsgError as error:
                tag("span", str(error), cls="soft")

    def _fields(self) -> None:
        """Add a field for every setting that has a label."""
        values = CampaignConfig().model_dump() | self.draft.settings
        values["generator"] = values["generator"] or ("vlm" if values["model"] or values["replay"] else "heuristic")
        named = {
            "world": self.worlds,
            "route": routes_of(str(values["world"])),
            "strategy": plugins.names("strategy"),
        }
        choices = {key: {name: name for name in names} for key, names in named.items()}
        choices["requirement"] = {name: f"{name}: {requirement.title}" for name, requirement in REQUIREMENTS.items()}
        choices["generator"] = generators()
        shown = {
            key: setting
            for key, setting in settings().items()
            if setting.label and not (setting.of_model and values["generator"] != "vlm")
        }
        listed = {key: shown.pop(key) for key in LISTED}
        self._form({"world": shown.pop("world")}, choices, values)
        for key, setting in listed.items():
            self._several(key, setting.label, choices[key], values)
        self._form(shown, choices, values)
        for key, names in {"robot": shipped_robots(), "stack": plugins.names("stack")}.items():
            with tag("datalist", id=f"st-{key}s"):
                for name in names:
                    tag("option", value=name)

    def _form(self, shown: dict[str, Setting], choices: dict[str, dict[str, str]], values: dict[str, Any]) -> None:
        with tag("div", cls="st-form"):
            for key, setting in shown.items():
                value, changed = values[key], partial(self._set, key)
                with field(setting.label, help="" if key in choices else setting.help):
                    if key in choices:
                        options = ({} if str(value) in choices[key] else {str(value): str(value)}) | choices[key]
                        select(options, str(value), changed)
                    elif (kind := value_type(key)) in (int, float):
                        attributes = {"inputmode": "numeric"} if kind is int else {"step": "any"}
                        number_input(value, changed, kind, **attributes)
                    else:
                        text_input(value, changed, autocomplete="off", list=f"st-{key}s")

    def _several(self, key: str, label: str, options: dict[str, str], values: dict[str, Any]) -> None:
        """Boxes to tick; more than one route or requirement makes a campaign for each pair."""
        asked = values[key] if isinstance(values[key], list) else [values[key]]
        chosen = list(options) if asked == ["all"] else [str(option) for option in asked]
        options = {option: option for option in chosen if option not in options} | options

        def ticked(name: str, on: bool) -> None:
            chosen[:] = [option for option in options if (on if option == name else option in chosen)]
            if chosen:
                self._set(key, chosen[0] if len(chosen) == 1 else list(chosen))
            else:
                self.page.say(f"Choose at least one of the {label.lower()}.", wrong=True)

        with tag("fieldset", cls="st-boxes"):
            tag("legend", label, cls="st-label")
            for name, text in options.items():
                if (group := GROUP_OF.get(name)) and key == "requirement" and name == GROUPED[group][0]:
                    tag("strong", group, cls="small soft st-whole")
                with tag("label", title=REQUIREMENTS[name].text if name in REQUIREMENTS else None):
                    box = tag("input", type="checkbox", name_=key)
                    if name in chosen:
                        box._props["^checked"] = True
                    with tag("span", text):
                        if name in REQUIREMENTS:
                            tag("span", REQUIREMENTS[name].text, cls="st-help")
                box.on("change", lambda event, name=name: ticked(name, bool(event.args)),
                       js_handler="(e) => emit(e.target.checked)")  # fmt: skip

    async def _estimate(self) -> None:
        self.estimate.set_text("Estimating…")
        listing, jobs = await load(self.page.workspace.whole_listing), await load(self.page.workspace.jobs.all)
        self.estimate.set_text(in_words(await load(estimate, self.draft.asked, listing.campaigns, jobs)))

    async def _start(self) -> None:
        workspace, config = self.page.workspace, self.draft.asked
        name = workspace.relative(workspace.path(str(config.folder)))
        if isinstance(config, Matrix):  # a campaign for each route and requirement, as one job
            matrix = Matrix.of(self.draft.settings | {"out": name}, {})
            assert matrix is not None
            await load(matrix.create)
            workspace.jobs.start("matrix", title="Campaigns", command=matrix.commands(), target=name, folder=name)
            ui.navigate.to(address("/matrix", folder=name))
            return
        defaults = CampaignConfig().model_dump()
        changed = {
            key: value
            for key, value in config.model_dump().items()
            if key not in ("out", *MACHINE) and (key == "strategy" or value != defaults[key])
        }
        campaign = await load(rvsg.Campaign.create, name, file=changed, begun_in=str(workspace.folder))
        machine = {key: getattr(config, key) for key in NOT_STORED if getattr(config, key) is not None}
        arguments = {"folder": name, "name": campaign.name, "machine": machine}
        command = command_for(config, out=Path(name))
        workspace.jobs.start("campaign", title="Campaign", command=command, target=name, **arguments)
        ui.navigate.to(address("/campaign", folder=name, name=campaign.name))


def in_words(estimated: Estimate) -> str:
    """Return an estimate as a sentence or two."""
    low, high = max(1, round(estimated.least)), max(1, round(estimated.minutes))
    minutes = f"{low} to {counted(high, 'minute')}" if low < high else f"About {counted(high, 'minute')}"
    earlier = estimated.campaigns
    basis = f"as the last {counted(earlier, 'campaign')} here took" if earlier else "tried just now"
    said = (
        f"{minutes}: at most {counted(estimated.runs, 'run')} to search and confirm, then causes and shrinking; "
        f"{estimated.run_s:.2f} s for a run on each of {counted(estimated.jobs, 'core')}, {basis}. "
        f"{counted(estimated.proposals, 'proposal')}."
    )
    if not estimated.calls_of:
        return f"{said} No model is called: it costs nothing."
    if estimated.known_calls == 0:
        unknown = f"No earlier campaign of this folder called {estimated.calls_of}: its time and cost are not known."
        return f"{said} {unknown}"
    cost = "at an unknown price" if estimated.usd is None else f"about {estimated.usd:.2f} USD"
    return f"{said} The calls of {estimated.calls_of}: {cost}, by {estimated.known_calls} earlier calls."


def routes_of(world: str) -> list[str]:
    """Return the names of the routes of a world; none of one that cannot be read: using it says why."""
    try:
        return [way.name for way in rvsg.load_world(world).routes]
    except RvsgError:
        return []
