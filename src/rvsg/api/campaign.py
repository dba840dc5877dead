"""A campaign as an object: create or open it, run it, confirm more, read what it found, report it."""

from __future__ import annotations

import contextlib
import threading
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rvsg.api.commands import command_for, confirm_command
from rvsg.api.config import CampaignConfig, check_stack_named, effective, safe_name
from rvsg.api.folder import (
    BEST,
    CONFIG,
    LEDGER,
    MATRIX,
    REPORT,
    alone_in,
    check_out,
    make_folder,
    opened,
    reading,
    store_of,
)
from rvsg.api.paths import as_stored, paths_of, spelled_out
from rvsg.api.record import CampaignRecord, check_same
from rvsg.api.remembered import COPY
from rvsg.api.scenarios import scenario_json
from rvsg.api.simulating import described, ignore
from rvsg.api.tracing import traces_beside
from rvsg.api.wiring import VLM_OPTIONS, Wired, jobs_of, remembered_file, wire
from rvsg.api.worlds import world_of
from rvsg.campaign import confirmation
from rvsg.campaign.attempt import Attempt, Ledger
from rvsg.campaign.encounter import MapCell as MapCell
from rvsg.campaign.encounter import failure_map
from rvsg.campaign.events import Event, Message, ModelCall
from rvsg.campaign.finding import DistinctFailure, Finding, distinct_failures, findings
from rvsg.campaign.loop import stream_campaign
from rvsg.campaign.pareto import Front as Front
from rvsg.campaign.pareto import front_of
from rvsg.campaign.plan import Plan
from rvsg.campaign.ranking import best_attempt, candidates, search_attempts, standing
from rvsg.core.errors import InputError, UnknownName
from rvsg.core.files import write_whole
from rvsg.core.plugins import Spec
from rvsg.evaluation.verdict import Verdict
from rvsg.generation.vlm.recording import CALLS, Recording
from rvsg.report.page import write_page
from rvsg.report.summary import Summary, summarise
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Mission
from rvsg.simulation.run import Run
from rvsg.world.world import World

if TYPE_CHECKING:
    from rvsg.campaign.parallel import Executor
    from rvsg.generation.generator import Generator
    from rvsg.simulation.protocol import Simulator
    from rvsg.simulation.stacks.protocol import NavigationStack


class Campaign:
    """A search for scenarios that violate a requirement, stored in a folder.

    Make one with `Campaign.create` or `Campaign.open`. It holds no file open between calls.
    """

    def __init__(
        self,
        record: CampaignRecord,
        config: CampaignConfig,
        *,
        generator: Generator | None = None,
        simulator: Simulator | None = None,
        stack: NavigationStack | None = None,
    ) -> None:
        self.record = record
        self.config = config
        self._given: dict[str, Any] = {"generator": generator, "simulator": simulator, "stack": stack}
        self._cancelled = threading.Event()
        self._prepared = False
        self._known: Wired | None = None
        self._store = config.folder
        self._named_stack: str | None = None

    @classmethod
    def create(
        cls,
        out: str | Path | None = None,
        *,
        file: Mapping[str, Any] | None = None,
        generator: str | Spec | Generator | None = None,
        simulator: str | Spec | Simulator | None = None,
        stack: str | Spec | NavigationStack | None = None,
        on_message: Callable[[str], None] = ignore,
        paths: Mapping[str, str] | None = None,
        begun_in: str | None = None,
        **settings: Any,
    ) -> Campaign:
        """Create a campaign in a folder. Where the folder holds one with the same settings, it resumes.

        Args:
            out: the folder; by default one under `runs/` named for the settings.
            file: settings of a campaign file, as `read_campaign_file` returns them.
            generator, simulator: a registered name, a Spec, or an instance of your own; an instance has to be given
                again to `open` the campaign.
            stack: the navigation stack under test, in the same ways, or as `module:Class`.
            on_message: called with what a person should know.
            paths: where typed paths among the settings are, if they are not relative to the current folder.
            begun_in: the folder they are relative to.
            settings: the keys of a campaign file: `world`, `route`, `requirement`, `scenarios`, `refinements`, ...

        Raises:
            InputError: a setting cannot be used, or the folder holds a campaign with other settings.
        """
        settings |= {} if out is None else {"out": str(out)}
        instances = _instances(settings, generator=generator, simulator=simulator, stack=stack)
        from_file = dict(file or {})
        config = effective(None, from_file, settings)
        check_out(config.folder)
        stored, config, known = _resumed(config, from_file, settings)
        check_stack_named(config.stack, settings.get("stack"))
        reject_unused_model_options(config, settings, on_message)
        wired = wire(config, {**(paths or {}), **known}, **instances)
        for note in wired.notes:
            on_message(note)
        begun_in = (stored.provenance.begun_in if stored else None) or begun_in or str(Path.cwd())
        record = CampaignRecord.of(config, wired.plan, wired.simulator_spec, begun_in)
        if stored is not None:
            record, reworded = stored.kept_words(record)
            if reworded:
                on_message(
                    f"{record.plan.requirement.name} is worded otherwise today ({', '.join(reworded)}); this campaign "
                    "keeps the words it was begun with."
                )
        campaign = cls(record, config, **instances)
        campaign._known = wired
        campaign._begin(stored)
        return campaign

    @classmethod
    def open(
        cls,
        folder: str | Path,
        name: str | None = None,
        *,
        generator: Generator | None = None,
        simulator: Simulator | None = None,
        stack: str | NavigationStack | None = None,
        **machine: Any,
    ) -> Campaign:
        """Open the campaign stored in a folder.

        Args:
            name: which one, where the store holds several; `campaigns_in` lists them.
            generator, simulator, stack: the instances it was created with, where these were no plug-ins.
                A stack that runs code of its own (module:Class, exec:COMMAND) has to be named again.
            machine: settings that decide no record: `jobs`, `executor`, `budget_usd`, ...

        Raises:
            InputError: the folder holds no campaign, or several and none is named.
            StoreError: the store cannot be read.
        """
        folder = Path(folder)
        with reading(folder) as ledger:
            record = record_in(ledger, folder, name)
        store = store_of(folder) if folder.is_dir() else None
        out = folder if folder.is_dir() else folder.parent
        kept = {"store": store[0], "store_options": store[1]} if store else {}
        config = effective(record.config | kept, {}, {**machine, "out": str(out)})
        instance = None if stack is None or isinstance(stack, str) else stack
        campaign = cls(record, config, generator=generator, simulator=simulator, stack=instance)
        campaign._named_stack = config.stack if instance is not None or stack == config.stack else None
        campaign._store = folder
        return campaign

    @property
    def folder(self) -> Path:
        """The folder of the campaign."""
        return self.config.folder

    @property
    def source(self) -> Path:
        """The folder or the ledger file it is read from."""
        return self._store

    @property
    def name(self) -> str:
        """The name of the campaign in its store."""
        return self.record.plan.name

    @property
    def plan(self) -> Plan:
        """What the campaign does."""
        return self.record.plan

    @property
    def requirement(self) -> Requirement:
        """The requirement, with its limit worked out for the route."""
        return self.record.plan.requirement

    @property
    def world(self) -> World:
        """The world of its mission; InputError where that world has changed since."""
        typed = self.record.config["world"]
        return world_of(self.plan.mission, near=(Path(self._paths.get(typed, typed)),))

    @property
    def simulator(self) -> Spec:
        """What makes its runs, with the stack under test, as `simulate` and `shrink` take it."""
        spec, stack = self.config.simulator_spec, self.config.stack_spec(self._paths)
        return spec if stack is None else Spec(spec.name, {**spec.options, "stack": stack})

    @property
    def command(self) -> str:
        """The command line that repeats the campaign."""
        return command_for(self.config)

    @property
    def notes(self) -> tuple[str, ...]:
        """What the generator has to say after a run, e.g. where a replay diverged from its record."""
        return self._known.generator.notes if self._known else ()

    @property
    def finished(self) -> bool:
        """Return whether everything planned is done."""
        return self.summary().complete

    @property
    def resumable(self) -> bool:
        """Return whether it lies where `run` finds it: not in a copied ledger file."""
        return self._store.is_dir() or self._store.name == LEDGER

    def prepare(self, on_message: Callable[[str], None] = ignore) -> None:
        """Compile or load what the simulator needs; `run` does it, too."""
        if not self._prepared:
            self._wired.simulator.prepare(on_message)
            self._prepared = True

    def run(
        self, *, jobs: int | None = None, executor: Executor | None = None, observe: Callable[[Event], None] = ignore
    ) -> Iterator[Event]:
        """Do what is left of the plan, yielding typed events (`rvsg.campaign.events`) in order.

        Every finished run and attempt is stored at once. A campaign that was interrupted or cancelled resumes with
        the next call and ends with the same records.

        Args:
            jobs: worker processes; by default as the settings say, else one per core. The records are the same.
            executor: an executor to share with other campaigns.
            observe: called with every event when it happens, also during the call of a model.
        """
        self._cancelled.clear()
        wired, plan = self._wired, self.plan
        pending: deque[Event] = deque()

        def note(event: Event) -> None:
            observe(event)
            pending.append(event)

        def tell(text: str) -> None:
            note(Message(campaign=plan.name, text=text))

        with alone_in(self.folder), self._ledger() as ledger:
            if not self.finished_in(ledger):
                self.prepare(tell)
            wired.generator.watch(lambda news: note(ModelCall(campaign=plan.name, news=news)))
            workers = jobs or jobs_of(self.config)
            with wired.simulations(ledger, tell, jobs=workers, executor=executor) as simulations:
                parts = wired.parts(plan, self.record.judging, ledger, simulations, self._cancelled.is_set)
                try:
                    for event in stream_campaign(plan, wired.strategy(ledger, plan), parts):
                        note(event)
                        while pending:
                            yield pending.popleft()
                finally:
                    wired.generator.watch(None)

    def cancel(self) -> None:
        """Stop a running campaign before its next run or proposal; may be called from another thread."""
        self._cancelled.set()

    def confirm(
        self,
        candidate: int,
        *,
        runs: int | None = None,
        jobs: int | None = None,
        observe: Callable[[Event], None] = ignore,
    ) -> Attempt:
        """Confirm one more candidate in runs with new seeds, beyond the budget of the plan.

        Args:
            candidate: the index of the attempt, as in `candidates`.
            runs: confirmation runs at most; by default those that a verdict may take, 30.

        Returns:
            The stored confirmation.

        Raises:
            InputError: there is no such candidate, or it is confirmed already.
        """
        wired, plan = self._wired, self.plan
        with alone_in(self.folder), self._ledger() as ledger:
            attempts = list(ledger.attempts(plan.name))
            chosen = next((a for a in search_attempts(attempts) if a.index == candidate), None)
            if chosen is None or chosen.proposal.scenario is None:
                raise InputError(f"Attempt {candidate} is no candidate of this campaign.")
            if any(a.confirms == candidate and a.purpose == "confirmation" for a in attempts):
                raise InputError(f"Attempt {candidate} is confirmed already.")
            self.prepare(lambda text: observe(Message(campaign=plan.name, text=text)))
            budget = runs or self.record.judging.max_runs
            with wired.simulations(ledger, ignore, jobs=jobs or jobs_of(self.config), executor=None) as simulations:
                parts = wired.parts(plan, self.record.judging, ledger, simulations, self._cancelled.is_set)
                for event in confirmation.confirm(plan, chosen, attempts, parts, budget=budget):
                    observe(event)
                attempts = list(ledger.attempts(plan.name))
                for event in confirmation.explain(plan, attempts, parts):
                    observe(event)
            return next(a for a in attempts if a.purpose == "confirmation" and a.confirms == candidate)

    def attempts(self) -> list[Attempt]:
        """Return everything that was tried so far, in order."""
        with self.reading() as ledger:
            return list(ledger.attempts(self.name))

    def candidates(self) -> list[Attempt]:
        """Return the configurations that violated in the search and are not confirmed yet, worst first."""
        attempts = self.attempts()
        confirmed = {a.confirms for a in attempts if a.purpose == "confirmation"}
        violating = [a for a in candidates(attempts, self.requirement) if standing(a, self.requirement)[0] > 0.0]
        return [a for a in violating if a.index not in confirmed]

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Every confirmation with what it means, the worst first."""
        with self.reading() as ledger:
            attempts = list(ledger.attempts(self.name))
            return findings(self.plan, attempts, run_of=ledger.run, world=self.world, procedure=self.record.judging)

    @property
    def distinct_failures(self) -> tuple[DistinctFailure, ...]:
        """The confirmed violations, grouped by where and how the robot fails; the worst group first."""
        return distinct_failures(self.findings)

    @property
    def fills_a_map(self) -> bool:
        """Whether the strategy of the campaign looks for every kind of encounter, not only for the worst one."""
        return bool(getattr(self._wired.strategy_class, "fills_a_map", False))

    @property
    def spends_runs(self) -> bool:
        """Whether its strategy divides the runs of the search among configurations as it sees fit."""
        return bool(getattr(self._wired.strategy_class, "spends_runs", False))

    @property
    def failure_map(self) -> tuple[MapCell, ...]:
        """The worst configuration of the search for every kind of encounter, the worst first."""
        with self.reading() as ledger:
            attempts = list(ledger.attempts(self.name))
            return failure_map(attempts, self.requirement, run_of=ledger.run, world=self.world)

    @property
    def front(self) -> Front | None:
        """The Pareto front of its requirements and its hypervolume; None where it has only one requirement."""
        return front_of(self.plan, self.attempts()) if self.plan.also else None

    def result(self) -> dict[str, Any]:
        """Return what was found as JSON-able data, as `rvsg run --json` prints it."""
        confirmed = self.findings
        found = {"confirmed": [finding.model_dump(mode="json") for finding in confirmed]}
        found["distinct_failures"] = [each.model_dump(mode="json") for each in distinct_failures(confirmed)]
        found["candidates"] = [
            {"attempt": a.index, "scenario": a.brief.scenario_index, "command": confirm_command(self.folder, a.index)}
            for a in self.candidates()
        ]
        found["failure_map"] = [cell.model_dump(mode="json") for cell in self.failure_map]
        front = self.front
        several = {"front": front.model_dump(mode="json") if front is not None else None}
        kept = {"out": str(self.folder), "report": str(self.folder / REPORT), "command": self.command}
        return self.summary().model_dump(mode="json", exclude={"confirmed"}) | found | several | kept

    def runs(self) -> Iterator[Run]:
        """Return every run of the campaign, one at a time, in the order of the attempts."""
        with self.reading() as ledger:
            ids = [m.run_id for attempt in ledger.attempts(self.name) for m in attempt.measurements]
            for run_id in dict.fromkeys(ids):
                yield ledger.run(run_id)

    def summary(self, attempts: Sequence[Attempt] | None = None) -> Summary:
        """Return what was found so far as plain data, or what some of its attempts found."""
        return summarise(self.plan, self.attempts() if attempts is None else attempts)

    @property
    def verdict(self) -> Verdict | None:
        """The verdict of the confirmation that says most against the robot; None before any."""
        confirmed = self.summary().confirmed
        return confirmed.verdict if confirmed else None

    def report(self, path: str | Path | None = None, *, world: World | str | Path | None = None) -> Path:
        """Write the report page, and the worst scenario beside it; return the page's path.

        Raises:
            InputError: the world or its route has changed since the campaign was run.
        """
        page = Path(path) if path is not None else self.page()
        place = self.world if world is None else world_of(self.plan.mission, world)
        check_same_route(self.plan.mission, place)
        with self.reading() as ledger:
            attempts = list(ledger.attempts(self.name))
            simulator = described(self.record.simulator)
            runs = {measured.run_id for attempt in attempts for measured in attempt.measurements}
            how: dict[str, Any] = {"traces": traces_beside(page, runs), "recording": self._recording()}
            how |= {"world": place, "run_of": ledger.run, "command": self.command, "simulator": simulator}
            if page.parent == self.folder and (self.folder.parent / MATRIX).exists():
                how["overview"] = f"../{REPORT}"
            write_page(page, self.plan, attempts, **how)
        best = best_attempt(attempts, self.requirement)
        if path is None and best is not None and best.proposal.scenario is not None:
            write_whole(self.folder / BEST, scenario_json(best.proposal.scenario))
        return page

    def _recording(self) -> Recording | None:
        """Return the calls of its model, where they are kept: in its folder, else in the folder it replays."""
        folders = [self.folder / "vlm"]
        if self.config.replay is not None:
            folders.append(Path(self._paths.get(self.config.replay, self.config.replay)))
        return next((Recording(each) for each in folders if (each / CALLS).is_file()), None)

    def page(self, *, several: bool = False) -> Path:
        """Return where its report is written; with a name of its own where the store holds several campaigns."""
        return self.folder / (f"report-{safe_name(self.name)}.html" if several else REPORT)

    def finished_in(self, ledger: Ledger) -> bool:
        """Return whether the ledger holds everything planned."""
        return summarise(self.plan, list(ledger.attempts(self.name))).complete

    @property
    def _paths(self) -> dict[str, str]:
        return paths_of(self.record.config, self.record.provenance.begun_in)

    @property
    def _wired(self) -> Wired:
        if self._known is None:
            check_stack_named(self.config.stack, self._named_stack)
            self._known = wire(self.config, self._paths, **self._given)
        return self._known

    def _ledger(self) -> contextlib.AbstractContextManager[Ledger]:
        return opened(self.folder, self.config.store, self.config.store_options)

    def reading(self) -> contextlib.AbstractContextManager[Ledger]:
        """Open its store to be read; closed at the end of the `with` block."""
        return reading(self._store)

    def _begin(self, stored: CampaignRecord | None) -> None:
        """Store the record and the campaign file, or check that the stored record is the same.

        A campaign without an attempt starts again: a wrong setting that its first call revealed can be corrected.
        """
        make_folder(self.folder)
        with alone_in(self.folder), self._ledger() as ledger:
            if stored is not None:
                try:
                    check_same(stored, self.record, self.folder)
                except InputError:
                    if not ledger.forget_empty(stored.plan.name):
                        raise
            if ledger.settings(self.name) is None:
                ledger.begin(self.name, self.record.data())
            if self.config.knowledge is not None and not (self.folder / COPY).exists():
                write_whole(self.folder / COPY, remembered_file(self.config, self._paths).read_bytes())
            values = CampaignConfig(**spelled_out(self.config.model_dump(), self._paths))
            write_whole(self.folder / CONFIG, values.to_yaml())


def reject_unused_model_options(
    config: CampaignConfig, settings: Mapping[str, Any], on_message: Callable[[str], None]
) -> None:
    """Refuse options of a model where no model is asked; those of a campaign file only cause a message."""
    if config.generator_name == "vlm":
        return
    if unused := [f"--{key.replace('_', '-')}" for key in VLM_OPTIONS if settings.get(key) is not None]:
        raise InputError(
            f'{", ".join(unused)}: this campaign uses the generator "{config.generator_name}", and only "vlm" takes '
            "such options. Leave them out, or use --generator vlm."
        )
    if unused := [key for key in VLM_OPTIONS if getattr(config, key) not in (None, "compact")]:
        on_message(
            f'The generator is "{config.generator_name}": {", ".join(unused)} in the campaign file have no effect.'
        )


def check_same_route(mission: Mission, world: World) -> None:
    """Refuse a world whose route is not that of the mission any more."""
    route = mission.route
    if any(each.name == route.name and each == route for each in world.routes):
        return
    raise InputError(
        f"{world.name}: {route.name} has changed since the campaign was run. Run the campaign again with another "
        "--out, or give a copy of the world it was run in with --world.",
        code="world-changed",
    )


def record_in(ledger: Ledger, where: Path, name: str | None = None) -> CampaignRecord:
    """Return the record of the campaign in a store; by default of its only one."""
    records = {known: record for known in ledger.campaigns() if (record := _record(ledger, known))}
    if name is not None:
        if name not in records:
            raise UnknownName("campaign", name, records, hint=f"Store: {where}.")
        return records[name]
    if not records:
        raise no_campaign(where, len(ledger.campaigns()))
    if len(records) > 1:
        listed = ", ".join(records)
        raise InputError(
            f"{where}: this store holds {len(records)} campaigns. Name one of them: {listed}.",
            code="campaign-ambiguous",
        )
    return next(iter(records.values()))


def no_campaign(where: Path, others: int) -> InputError:
    """Return the error for a store without a campaign."""
    if others:
        return InputError(
            f"{where}: this store holds imported results or attempts of a script ({others}), and no campaign with a "
            f"record. Write the study's tables of imported results with: rvsg report {where} --tables DIR"
        )
    return InputError(f"{where}: this store holds no campaign yet; `rvsg run --out DIR` makes one.")


def _record(ledger: Ledger, name: str) -> CampaignRecord | None:
    settings = ledger.settings(name)
    return CampaignRecord.read(settings) if settings is not None else None


def _resumed(
    config: CampaignConfig, from_file: Mapping[str, Any], settings: Mapping[str, Any]
) -> tuple[CampaignRecord | None, CampaignConfig, dict[str, str]]:
    """Return the stored record of the folder, the settings on top of it, and where their paths are."""
    folder = config.folder
    known = store_of(folder)
    if known is None:
        return None, config, {}
    if config.store not in ("sqlite", known[0]):
        raise InputError(f"{folder}: its campaign is kept by the store {known[0]!r}, not {config.store!r}.")
    with opened(folder, *known) as ledger:
        names = ledger.campaigns()
        kept = ledger.settings(names[0]) if names else None
    if kept is None:
        return None, config, {}
    stored = CampaignRecord.read(kept)
    if stored is None:
        raise InputError(f"{folder}: this folder holds imported results, no campaign. Choose another --out.")
    paths = paths_of(stored.config, stored.provenance.begun_in)
    values = stored.config | {"store": known[0], "store_options": known[1]}
    asked = effective(values, as_stored(from_file, paths), as_stored(settings, paths))
    return stored, asked, paths


def _instances(settings: dict[str, Any], **given: Any) -> dict[str, Any]:
    """Put plug-ins given by name or Spec among the settings, and return the instances by kind."""
    instances: dict[str, Any] = {}
    for kind, plugin in given.items():
        if plugin is None:
            continue
        if isinstance(plugin, str | Spec):
            spec = Spec.of(plugin)
            settings[kind] = spec.name
            if spec.options:
                settings[f"{kind}_options"] = spec.options
        else:
            instances[kind] = plugin
            settings[kind] = plugin.name or type(plugin).__name__
    return instances
