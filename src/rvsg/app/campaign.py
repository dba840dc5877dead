"""Campaigns: create or open one in a folder, run it, confirm more of what it found."""

from __future__ import annotations

import contextlib
import subprocess
import threading
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rvsg.app.folder import CONFIG, LEDGER, alone_in, check_out, opened, reading, store_of
from rvsg.app.input_files import as_campaign_file, as_stored, copy_inputs, located, paths_of
from rvsg.app.record import CampaignRecord, changed_settings, no_campaign, other_settings, record_in
from rvsg.app.settings import VLM_OPTIONS, CampaignConfig, effective, option_of, remembered
from rvsg.app.stored_campaign import StoredCampaign
from rvsg.app.wiring import COPY, Wired, jobs_of, remembered_file, strategy_class, wire
from rvsg.core import permission
from rvsg.core.errors import InputError
from rvsg.core.files import make_folder, write_whole
from rvsg.core.plugins import Spec, ignore
from rvsg.findings.findings import entries_of_campaign
from rvsg.findings.ranking import search_attempts, standing
from rvsg.report.result import is_complete
from rvsg.runs.attempt import Attempt
from rvsg.runs.ledger import CachedLedger, Ledger
from rvsg.search.confirmation import Confirmations
from rvsg.search.drive_alone import campaigns_of
from rvsg.search.execution import Event, Message, ModelCall
from rvsg.search.loop import stream_campaign
from rvsg.simulation.simulators import tell_of_robot
from rvsg.store.knowledge_base import KnowledgeBase

if TYPE_CHECKING:
    from rvsg.generation.generator import Generator
    from rvsg.runs.runner import Executor
    from rvsg.simulation.simulators import Simulator
    from rvsg.simulation.stacks.protocol import NavigationStack


def instances_among(settings: dict[str, Any], **given: Any) -> dict[str, Any]:
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


def resumed(
    config: CampaignConfig, from_file: Mapping[str, Any], settings: Mapping[str, Any]
) -> tuple[CampaignRecord | None, CampaignConfig, dict[str, str]]:
    """Return the stored record of the folder, the settings on top of it, and where their paths are."""
    folder = config.folder
    store = store_of(folder)
    if store is None:
        return None, config, {}
    if config.store not in ("sqlite", store[0]):
        raise InputError(
            f"{folder}: its campaign is kept by the store {store[0]!r}, not {config.store!r}.", code="other-store"
        )
    stored = _first_record(folder, *store)
    if stored is None:
        return None, config, {}
    paths = paths_of(stored.config, stored.provenance.begun_in, folder)
    values = stored.config | remembered(folder / CONFIG) | {"store": store[0], "store_options": store[1]}
    asked = effective(values, as_stored(from_file, paths), as_stored(settings, paths))
    return stored, asked, paths


def _first_record(folder: Path, store: str, options: dict[str, Any]) -> CampaignRecord | None:
    """Return the record of the campaign in a folder; None where none has begun."""
    with opened(folder, store, options) as ledger:
        names = campaigns_of(ledger)
        settings = ledger.settings(names[0]) if names else None
    record = None if settings is None else CampaignRecord.read(settings)
    if settings is not None and record is None:
        raise InputError(
            f"{folder}: this folder holds imported results, no campaign. Choose another --out.", code="imported-results"
        )
    return record


def reject_unused_model_options(
    config: CampaignConfig, settings: Mapping[str, Any], on_message: Callable[[str], None]
) -> None:
    """Refuse options of a model where no model is asked; those of a campaign file only cause a message."""
    if config.generator_name == "vlm":
        return
    if unused := [option_of(key) for key in VLM_OPTIONS if settings.get(key) is not None]:
        raise InputError(
            f'{", ".join(unused)}: this campaign uses the generator "{config.generator_name}", and only "vlm" takes '
            "such options. Leave them out, or use --generator vlm.",
            code="model-options-unused",
        )
    if unused := [key for key in VLM_OPTIONS if getattr(config, key) not in (None, "compact")]:
        on_message(
            f'The generator is "{config.generator_name}": {", ".join(unused)} in the campaign file have no effect.'
        )


def _compile_search() -> subprocess.Popen[bytes] | None:
    """Begin to compile what the search computes with, beside the simulator's kernels; None if it is in the cache."""
    from rvsg.core.kernels import compile_aside, is_cached
    from rvsg.generation import forecast
    from rvsg.search import race

    work: list[tuple[Any, tuple[Any, ...]]] = [(race.fit, race.FIT), (forecast.run_all, forecast.kinds_of_run_all())]
    missing = [kernel for kernel in work if not is_cached(kernel[0])]
    return compile_aside(missing, nice=10) if missing else None


class Campaign(StoredCampaign):
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
        super().__init__(record, config, config.folder)
        self._given: dict[str, Any] = {"generator": generator, "simulator": simulator, "stack": stack}
        self._cancelled = threading.Event()
        self._prepared = False
        self._known: Wired | None = None
        self._named: tuple[Any, ...] = ()
        """What the caller named; code that only the record names is not run."""

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
        named: Sequence[Any] = (),
        **settings: Any,
    ) -> Campaign:
        """Create a campaign in a folder. Where the folder holds one with the same settings, it resumes.

        Args:
            out: the folder; by default one under `runs/` named for the settings.
            file: settings of a campaign file, as `read_campaign_file` returns them.
            generator: like `simulator` a registered name, a Spec, or an instance of your own; an instance has to be
                given again to `open` the campaign, and stays open after a run.
            stack: the navigation stack under test, in the same ways, or as `module:Class`.
            on_message: called with what a person should know.
            paths: where typed paths among the settings are, if they are not relative to the current folder.
            begun_in: the folder they are relative to.
            named: what else the user named: code of the file that is named here may run, too.
            settings: the keys of a campaign file: `world`, `route`, `requirement`, `scenarios`, `refinements`, ...

        Raises:
            InputError: a setting cannot be used, or the folder holds a campaign with other settings.
        """
        settings |= {} if out is None else {"out": str(out)}
        instances = instances_among(settings, generator=generator, simulator=simulator, stack=stack)
        from_file = dict(file or {})
        config = effective(None, from_file, settings)
        check_out(config.folder)
        stored, config, stored_paths = resumed(config, from_file, settings)
        reject_unused_model_options(config, settings, on_message)
        paths = {**(paths or {}), **stored_paths}
        with permission.only(settings, named):
            wired = wire(located(config, paths), **instances)
        for note in wired.notes:
            on_message(note)
        begun_in = (stored.provenance.begun_in if stored else None) or begun_in or str(Path.cwd())
        specs = (wired.strategy_spec, wired.simulator_spec)
        record = CampaignRecord.of(config, wired.plan, *specs, wired.plugins, begun_in)
        if stored is not None:
            record, reworded = stored.kept_words(record)
            if reworded:
                on_message(
                    f"{record.plan.requirement.name} is worded otherwise today ({', '.join(reworded)}); this campaign "
                    "keeps the words it was begun with."
                )
        campaign = cls(record, wired.config, **instances)
        campaign._known = wired
        campaign._begin(stored, config, paths)
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
            generator: like `simulator` and `stack` the instance it was created with, where this was no plug-in.
            stack: one that runs code of its own (module:Class, exec:COMMAND) has to be named again, or
                what else of the record leads to code, as in `executor_options`.
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
        store_settings = {"store": store[0], "store_options": store[1]} if store else {}
        config = effective(record.config | remembered(out / CONFIG) | store_settings, {}, {**machine, "out": str(out)})
        config = located(config, paths_of(record.config, record.provenance.begun_in, out))
        instance = None if stack is None or isinstance(stack, str) else stack
        campaign = cls(record, config, generator=generator, simulator=simulator, stack=instance)
        campaign._named = ({"stack": stack}, machine)
        campaign.source = folder
        return campaign

    def prepare(self, on_message: Callable[[str], None] = ignore) -> None:
        """Compile or load what the simulator needs; `run` does it, too."""
        if not self._prepared:
            aside = _compile_search()
            self._wired.simulator.prepare(on_message)
            if aside is not None:
                aside.wait()
            tell_of_robot(self._wired.plan.mission, self._wired.simulator, on_message)
            self._prepared = True

    def run(
        self, *, jobs: int | None = None, executor: Executor | None = None, observe: Callable[[Event], None] = ignore
    ) -> Iterator[Event]:
        """Do what is left of the plan, yielding typed events (`rvsg.search.execution`) in order.

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

        with alone_in(self.folder), self._ledger() as store:
            ledger = CachedLedger(store)
            if not is_complete(plan, list(store.attempts(plan.name))):
                self.prepare(tell)
            wired.generator.watch(lambda news: note(ModelCall(campaign=plan.name, news=news)))
            workers = jobs or jobs_of(self.config)
            with wired.runner(ledger, tell, jobs=workers, executor=executor) as runner:
                parts = wired.parts(plan, self.record.judging, ledger, runner, self._cancelled.is_set)
                try:
                    for event in stream_campaign(plan, wired.strategy(ledger, plan, self.record.strategy), parts):
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
        with alone_in(self.folder), self._ledger() as store:
            ledger = CachedLedger(store)
            attempts = list(ledger.attempts(plan.name))
            chosen = next((a for a in search_attempts(attempts) if a.index == candidate), None)
            if chosen is None or chosen.scenario_id is None or standing(chosen, self.requirement)[0] <= 0.0:
                listed = ", ".join(str(a.index) for a in self.candidates()) or "none is left"
                raise InputError(
                    f"Attempt {candidate} is no candidate: it did not violate {self.requirement.name} in the search. "
                    f"Candidates: {listed}.",
                    code="no-candidate",
                )
            if any(a.scenario_id == chosen.scenario_id and a.purpose == "confirmation" for a in attempts):
                raise InputError(f"Attempt {candidate} is confirmed already: its scenario is.", code="confirmed")
            self.prepare(lambda text: observe(Message(campaign=plan.name, text=text)))
            budget = runs or self.record.judging.max_runs
            with wired.runner(ledger, ignore, jobs=jobs or jobs_of(self.config), executor=None) as runner:
                parts = wired.parts(plan, self.record.judging, ledger, runner, self._cancelled.is_set)
                confirming = Confirmations(plan, attempts, parts)
                for event in chain(confirming.confirm(chosen, budget=budget), confirming.explain()):
                    observe(event)
            return next(a for a in confirming.attempts if a.purpose == "confirmation" and a.confirms == candidate)

    @property
    def notes(self) -> tuple[str, ...]:
        """What the generator has to say after a run, e.g. where a replay diverged from its record."""
        return self._known.generator.notes if self._known else ()

    @property
    def spends_runs(self) -> bool:
        """Whether its strategy divides the runs of the search among configurations as it sees fit."""
        return strategy_class(self.config).spends_runs

    @property
    def _wired(self) -> Wired:
        if self._known is None:
            with permission.only(self._named):
                wired = wire(self.config, **self._given)
            if changed := changed_settings(self.record, self.record.replace(plugins=wired.plugins)):
                raise other_settings(self.folder, changed)
            self._known = wired
        return self._known

    def _ledger(self) -> contextlib.AbstractContextManager[Ledger]:
        return opened(self.folder, self.config.store, self.config.store_options)

    def _begin(self, stored: CampaignRecord | None, typed: CampaignConfig, paths: Mapping[str, str]) -> None:
        """Store the record, the input files and the campaign file, or check that the stored record is the same.

        A campaign without an attempt starts again: a wrong setting that its first call revealed can be corrected.
        """
        make_folder(self.folder)
        with alone_in(self.folder), self._ledger() as ledger:
            changed = changed_settings(stored, self.record) if stored is not None else {}
            if stored is not None and changed and not ledger.forget_empty(stored.plan.name):
                raise other_settings(self.folder, changed)
            new = ledger.settings(self.name) is None
            copy_inputs(typed.model_dump(), paths, self.folder, anew=new)
            if new:
                ledger.begin(self.name, self.record.data())
            if self.config.knowledge is not None and not (self.folder / COPY).exists():
                write_whole(self.folder / COPY, remembered_file(self.config).read_bytes())
            write_whole(self.folder / CONFIG, as_campaign_file(typed, paths, self.folder).to_yaml())


def campaigns_below(folder: Path) -> list[Campaign]:
    """Return the campaigns of a folder, or of the folders in it where it holds none itself.

    Raises:
        InputError: there is no campaign.
        StoreError: there is no store, or it cannot be read.
    """
    below = sorted(path.parent for path in folder.glob(f"*/{LEDGER}")) if folder.is_dir() else []
    if store_of(folder) is not None or not below:
        return campaigns_in(folder)
    return [campaign for path in below for campaign in campaigns_in(path)]


def campaigns_in(store: Path, *, optional: bool = False) -> list[Campaign]:
    """Return every campaign of a store, in the order they were begun.

    Args:
        store: the folder of a campaign, or a ledger file.
        optional: return none where there is no campaign, instead of raising.

    Raises:
        InputError: the store holds no campaign.
        StoreError: there is no store, or it cannot be read.
    """
    with reading(store) as ledger:
        campaigns = ledger.campaigns()
        settings = [(name, ledger.settings(name)) for name in campaigns]
    names = [name for name, values in settings if values is not None and CampaignRecord.read(values) is not None]
    if not names and not optional:
        raise no_campaign(store, len(campaigns))
    return [Campaign.open(store, name) for name in names]


def learn_campaign(base: KnowledgeBase, source: Campaign | str | Path) -> int:
    """Add what one campaign, or those in a folder, teach; return how many entries are new."""
    if not isinstance(source, Campaign):
        return sum(learn_campaign(base, campaign) for campaign in campaigns_below(Path(source)))
    with source.result() as result:
        entries = list(
            entries_of_campaign(
                result.attempts,
                result.findings,
                source.plan.mission,
                source.requirement,
                source.world.floor_id,
                source.record.simulator.name,
            )
        )
    return base.add(entries, origin=f"campaign {source.name}")
