"""The parts of the loop as RVSG ships them: what they watch, how they judge, what they plan, how they run it."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from rvsg.api.campaign import Campaign
from rvsg.api.folder import LEDGER, reading
from rvsg.api.index import campaigns_in
from rvsg.api.proposing import brief_of
from rvsg.api.scenarios import walk
from rvsg.api.suite_cases import CaseWork
from rvsg.api.suites import requirement_of
from rvsg.api.watch_subject import LiveSuite, Subject
from rvsg.campaign.knowledge import Entry, remembered
from rvsg.campaign.suite import Case, CaseResult, Expectation
from rvsg.campaign.watch.parts import Planned, RuleSet, Sign, Symptom, Watched
from rvsg.core.errors import InputError, RvsgError
from rvsg.core.seeds import seed_for
from rvsg.evaluation.judge import judge, objective
from rvsg.evaluation.naming import WaypointNames
from rvsg.generation.generator import Generator
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import HumanConfiguration, Mission, Scenario
from rvsg.scenario.variation import waypoints_used
from rvsg.store.knowledge import KnowledgeBase
from rvsg.world.world import World
from rvsg_exchange.formats import is_recording, load_recordings

VERSION = "version.txt"
"""A file in the watched folder with the label of the stack that drives."""
STAYED_SAMPLES = 20
"""Samples (a second at 20 Hz) that a person is near a waypoint before it counts as visited."""


@dataclass
class RecordingMonitor:
    """Watches a folder for recordings of a robot: `.mcap` and `.db3` files, and rosbag2 folders.

    Recordings lie in folders named for their routes, or all are of `route`. `version.txt` in the folder labels the
    stack. A file that cannot be read yet, e.g. because it is still written, is tried again in the next cycle.
    """

    folder: Path
    world: World
    route: str | None = None
    _told: dict[str, str] = field(default_factory=dict)
    _new: list[str] = field(default_factory=list)

    def new(self, seen: frozenset[str]) -> Iterator[Watched]:
        """Yield the runs of the recordings that are not among those seen, in the order of their names."""
        version = _version_in(self.folder)
        for path in sorted(self._recordings()):
            source = path.relative_to(self.folder).as_posix()
            if source in seen:
                continue
            try:
                route = self.route or self._route(path)
                runs, _ = load_recordings([path], world=self.world, route=route)
            except RvsgError as error:
                if self._told.get(source) != str(error):
                    self._told[source] = str(error)
                    self._new.append(f"{source} cannot be read yet: {error}")
                continue
            yield Watched(source=source, route=route, version=version, run=runs[0])

    def troubles(self) -> Sequence[str]:
        """Return what could not be read, each once."""
        found, self._new = self._new, []
        return found

    def _recordings(self) -> Iterator[Path]:
        folders = [path.parent for path in self.folder.rglob("metadata.yaml") if not self._is_draft(path)]
        yield from folders
        for path in self.folder.rglob("*"):
            wanted = path.suffix in (".mcap", ".db3") and path.parent not in folders
            if wanted and not self._is_draft(path) and is_recording(path):
                yield path

    def _is_draft(self, path: Path) -> bool:
        """Return whether a file is hidden, as what is still written is."""
        return any(part.startswith(".") for part in path.relative_to(self.folder).parts)

    def _route(self, path: Path) -> str:
        known = {route.name for route in self.world.routes}
        parents = [part.name for part in path.relative_to(self.folder).parents]
        found = next((name for name in (path.stem, *parents) if name in known), None)
        if found is None:
            raise InputError(
                "which route is it? Put it into a folder named for the route of the world "
                f"({', '.join(sorted(known))}), or give --route."
            )
        return found


@dataclass
class CampaignMonitor:
    """Watches campaigns, also running ones: every run of their searches and confirmations, once."""

    folder: Path
    _new: list[str] = field(default_factory=list)

    def new(self, seen: frozenset[str]) -> Iterator[Watched]:
        """Yield the runs that are not among those seen."""
        for place in _ledgers(self.folder):
            try:
                campaigns = campaigns_in(place, optional=True)
            except RvsgError as error:
                self._new.append(f"{place.name} cannot be read yet: {error}")
                continue
            for campaign in campaigns:
                yield from _runs_of(campaign, seen)

    def troubles(self) -> Sequence[str]:
        """Return what could not be read."""
        found, self._new = self._new, []
        return found


@dataclass
class SuiteAnalyser:
    """Judges what was watched by the requirements of the suite, and compares it with what the suite tests."""

    suite: LiveSuite
    world: World
    near: float
    versions: Callable[[], Sequence[str]]
    """The versions that were acted on, in their order."""
    subject: Callable[[], str] = lambda: ""
    """The version of the stack under test; empty if it has none."""
    learned: Callable[[], Sequence[Entry]] = lambda: ()
    """What is known already; places in it are tested."""

    def analyse(self, watched: Sequence[Watched]) -> list[Sign]:
        """Return the signs of all runs, those of a new version first."""
        signs = list(self._new_version(watched))
        for each in watched:
            signs += self._limits(each)
        return signs + self._places(watched)

    def _new_version(self, watched: Sequence[Watched]) -> Iterator[Sign]:
        """Yield the version of the stack under test, or if it has none, that of the recordings."""
        seen = next((each for each in reversed(watched) if each.version), None)
        version, source = self.subject(), "the stack under test"
        if not version and seen is not None:
            version, source = seen.version, seen.source
        known = self.versions()
        if version and version != (known[-1] if known else ""):
            text = f"the stack's version is {version}, it was {known[-1] if known else 'unknown'}"
            symptom = Symptom(kind="new version", version=version, change=len(known))
            yield Sign(symptom=symptom, source=source, text=text)

    def entries(self, watched: Sequence[Watched]) -> list[Entry]:
        """Return what each run shows by each requirement."""
        found = []
        for each in watched:
            for requirement in self._requirements(each.route).values():
                value = objective(each.run, requirement, world=self.world)
                if value is None:
                    continue
                found.append(
                    Entry(
                        kind="watched",
                        world=self.world.name,
                        place=self.world.floor_id,
                        route=each.route,
                        requirement=requirement.name,
                        description=f"watched: {each.source}",
                        simulator=each.run.simulator,
                        verdict=judge(requirement, [value], arrived=[each.run.completed]),
                        lessons=(f"version {each.version}",) if each.version else (),
                    )
                )
        return found

    def _requirements(self, route: str) -> dict[str, Requirement]:
        """Return the requirements on a route by their names in the suite; all of them where it has no case there."""
        cases = [case for case in self.suite.cases if case.scenario.mission.route.name == route] or self.suite.cases
        found = {}
        for case in cases:
            for expectation in case.expectations:
                found[expectation.requirement] = requirement_of(expectation, self.suite.folder, self.world.route(route))
        return {name: each for name, each in found.items() if each.threshold is not None}

    def _limits(self, each: Watched) -> Iterator[Sign]:
        for name, requirement in self._requirements(each.route).items():
            value = objective(each.run, requirement, world=self.world)
            if value is None or requirement.threshold is None:
                continue
            limit = requirement.threshold
            margin = requirement.badness(limit) - requirement.badness(value)
            if margin > self.near * max(abs(limit), 1e-9) and not requirement.violated_by(value):
                continue
            kind = "violated" if requirement.violated_by(value) else "near its limit"
            symptom = Symptom(kind=kind, route=each.route, requirement=name, version=each.version or self.subject())
            text = f"{each.source} on {each.route}: {name} {kind}, {value:.3g} {requirement.unit} (limit {limit:.3g})"
            yield Sign(symptom=symptom, source=each.source, text=text)

    def _places(self, watched: Sequence[Watched]) -> list[Sign]:
        """Return a sign for each route on which people were where no scenario has anybody."""
        names = WaypointNames(self.world.grid)
        walkable = {w.name for w in self.world.grid.waypoints if w.human}
        tested: dict[str, set[str]] = defaultdict(set)
        for case in self.suite.cases:
            tested[case.scenario.mission.route.name].update(waypoints_used(case.scenario.people))
        for entry in self.learned():
            tested[entry.route].update(entry.waypoints)
        visited: dict[str, dict[str, str]] = defaultdict(dict)
        for each in watched:
            path = each.run.trajectory
            for person in range(path.human_x.shape[1]):
                near = names.nearest(path.human_x[:, person], path.human_y[:, person])
                for name, count in zip(*np.unique(np.asarray(near), return_counts=True), strict=True):
                    if count >= STAYED_SAMPLES and str(name) in walkable - tested[each.route]:
                        visited[each.route].setdefault(str(name), each.source)
        return [
            Sign(
                symptom=Symptom(kind="never tested", route=route, places=tuple(sorted(found))),
                source=next(iter(found.values())),
                text=f"people on {route} where no scenario has anybody: {', '.join(sorted(found))}",
            )
            for route, found in sorted(visited.items())
            if found
        ]


@dataclass
class SuitePlanner:
    """Plans scenarios: the suite's cases for a new version, variants by a generator, walks through untested places."""

    suite: LiveSuite
    world: World
    rules: RuleSet
    generator: Generator
    knowledge: KnowledgeBase
    seed: int = 0
    variants: int = 1

    def plan(self, symptom: Symptom, *, index: int) -> list[Planned]:
        """Return scenarios for a symptom."""
        if symptom.kind == "new version":
            return [self._case(symptom, case) for case in self.suite.cases]
        if symptom.kind == "never tested":
            return self._walks(symptom)
        return self._variants(symptom, index)

    def _case(self, symptom: Symptom, case: Case) -> Planned:
        return Planned(
            why=symptom,
            name=f"case {case.name}",
            scenario=case.scenario,
            requirements=tuple(each.requirement for each in case.expectations),
            runs=min(case.max_runs, self.rules.max_runs_per_plan),
            is_case=True,
        )

    def _variants(self, symptom: Symptom, index: int) -> list[Planned]:
        """Ask the generator for scenarios that differ from what is known of this route and requirement."""
        expectation = Expectation(requirement=symptom.requirement)
        route = self.world.route(symptom.route)
        requirement = requirement_of(expectation, self.suite.folder, route)
        known = self.knowledge.entries(world=self.world.name, route=symptom.route, requirement=requirement.name)
        found = []
        for k in range(self.variants):
            seed = seed_for(self.seed, "watch", index, k)
            brief = brief_of(Mission.of(self.world, route), requirement, humans=2, seed=seed, feedback=None)
            scenario = self.generator.propose(brief.replace(memory=remembered(known)[-10:]), self.world).scenario
            if scenario is not None:
                name = f"variant {index}.{k} for {symptom.requirement} on {symptom.route}"
                found.append(self._new(symptom, name, scenario, (symptom.requirement,)))
        return found

    def _walks(self, symptom: Symptom) -> list[Planned]:
        """Let somebody walk between the untested waypoints farthest apart, or to a neighbour of the only one."""
        grid = self.world.grid
        places = list(symptom.places)
        if len(places) == 1:
            places += [b if a == places[0] else a for a, b in grid.hops if places[0] in (a, b)][:1]
        pairs = [(a, b) for i, a in enumerate(places) for b in places[i + 1 :] if grid.shortest_path(a, b)]
        if not pairs:
            return []
        first, last = max(pairs, key=lambda pair: (_apart(self.world, *pair), pair))
        route = self.world.route(symptom.route)
        person = walk("Human 1", first, last, speed_m_s=1.2).human(self.world)
        scenario = Scenario(
            mission=Mission.of(self.world, route),
            people=HumanConfiguration(humans=(person,)),
            description=f"Somebody walks between {first} and {last}: people were seen there, in no scenario.",
        )
        cases = [case for case in self.suite.cases if case.scenario.mission.route.name == route.name]
        asked = {each.requirement for case in cases or self.suite.cases for each in case.expectations}
        return [self._new(symptom, f"walk {first} to {last} on {route.name}", scenario, tuple(sorted(asked)))]

    def _new(self, why: Symptom, name: str, scenario: Scenario, requirements: tuple[str, ...]) -> Planned:
        runs = min(self.suite.head.judging.max_runs, self.rules.max_runs_per_plan)
        return Planned(why=why, name=name, scenario=scenario, requirements=requirements, runs=runs)


@dataclass
class SimulationExecutor:
    """Runs a plan in a simulator until its verdicts are sure, at most the runs it was accepted with."""

    suite: LiveSuite
    world: World
    subject: Subject
    jobs: int = 1

    def execute(self, planned: Planned) -> list[CaseResult]:
        """Return a result for each requirement."""
        known = next((case for case in self.suite.cases if case.scenario == planned.scenario), None)
        expectations = known.expectations if planned.is_case and known else None
        case = Case(
            name=known.name if planned.is_case and known else "planned",
            title=planned.name[:200],
            expectations=expectations or tuple(Expectation(requirement=name) for name in planned.requirements),
            scenario=planned.scenario,
            max_runs=planned.runs,
        )
        route = planned.scenario.mission.route
        asked = tuple(requirement_of(each, self.suite.folder, route) for each in case.expectations)
        procedure = self.suite.head.judging.replace(max_runs=planned.runs)
        work = CaseWork(case, self.world, asked, procedure, self.subject.simulator)
        return list(work.results(runs=None, jobs=self.jobs, pictures=None, on_message=lambda _: None))


def is_campaign(folder: Path) -> bool:
    """Return whether a folder holds campaigns rather than recordings."""
    return bool(_ledgers(folder))


def _ledgers(folder: Path) -> list[Path]:
    return [path.parent for path in sorted([*folder.glob(LEDGER), *folder.glob(f"*/{LEDGER}")])]


def _runs_of(campaign: Campaign, seen: frozenset[str]) -> Iterator[Watched]:
    version = str(campaign.record.simulator)
    with reading(campaign.source) as ledger:
        for attempt in ledger.attempts(campaign.name):
            if attempt.purpose not in ("search", "confirmation"):
                continue
            for measured in attempt.measurements:
                if measured.run_id not in seen:
                    run = ledger.run(measured.run_id)
                    route = campaign.plan.mission.route.name
                    yield Watched(source=measured.run_id, route=route, version=version, run=run)


def _version_in(folder: Path) -> str:
    file = folder / VERSION
    return file.read_text(encoding="utf-8").strip()[:200] if file.is_file() else ""


def _apart(world: World, first: str, second: str) -> float:
    (ax, ay), (bx, by) = world.grid.position(first), world.grid.position(second)
    return float(np.hypot(bx - ax, by - ay))
