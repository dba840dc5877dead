"""Parts of a watch over a suite: the suite, the stack under test, recordings, analysis, plans and runs."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from rvsg.core.errors import InputError, RvsgError
from rvsg.core.plugins import Spec
from rvsg.core.seeds import seed_for
from rvsg.evaluation.verdict import judge, objective
from rvsg.findings.findings import Entry, remembered
from rvsg.generation.generator import Generator
from rvsg.scenario.builder import walk
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import HumanConfiguration, Mission, Scenario
from rvsg.scenario.variation import waypoints_used
from rvsg.search.run_set import is_recording, load_recordings
from rvsg.search.strategies import single_brief
from rvsg.simulation.simulators import Simulator, make_simulator
from rvsg.simulation.stacks.stack_choice import StackChoice
from rvsg.suites.suite import Case, CaseResult, Expectation, State
from rvsg.suites.suite_folder import SuiteCase, SuiteFolder, SuiteHead, requirement_of, run_cases
from rvsg.watch.self_adaptation import Change, Journal, Planned, RuleSet, Sign, Symptom, Watched
from rvsg.world.world import World

Stamp = tuple[tuple[str, int, int], ...]


class LiveSuite:
    """A suite that is read again when its files change.

    Args:
        suite: the suite as it was opened.
        version: the version under test, for the reason of a known failure.

    Raises:
        InputError: it has no case, or cases in several worlds.
    """

    def __init__(self, suite: SuiteFolder, version: Callable[[], str] = lambda: "") -> None:
        self.version = version
        self.world = _world(suite)
        self._suite = suite
        self._stamp = _stamp(suite.folder)

    @property
    def folder(self) -> Path:
        """The folder of the suite."""
        return self._suite.folder

    @property
    def head(self) -> SuiteHead:
        """What `suite.yaml` holds."""
        return self._suite.head

    @property
    def cases(self) -> tuple[Case, ...]:
        """The cases as they were read last."""
        return self._suite.cases

    def renew(self) -> list[str]:
        """Read the suite again where a file changed; return why it cannot be read, and keep the former one then."""
        stamp = _stamp(self.folder)
        if stamp == self._stamp:
            return []
        self._stamp = stamp
        try:
            suite = SuiteFolder.open(self.folder)
            if _world(suite).id != self.world.id:
                raise InputError("its scenarios are in another world now. Begin a new watch for that world.")
        except RvsgError as error:
            return [f"the suite is left as it was: {error}"]
        self._suite = suite
        return []

    def changes(self, planned: Planned, results: Sequence[CaseResult]) -> list[Change]:
        """Return new known failures, and cases that are fixed. A broken case stays broken: a person decides on it."""
        if planned.is_case:
            cases = {case.name: case for case in self.cases}
            return [self._fixed(cases[r.case], r) for r in results if r.state is State.FIXED and r.case in cases]
        return [self._failure(planned, result) for result in results if result.state is State.BROKEN]

    def alike(self, change: Change) -> int:
        """Return how many failures of the requirement on the route of a change the suite knows."""
        route = change.scenario.mission.route.name
        return sum(
            case.scenario.mission.route.name == route
            and case.scenario.id != change.scenario.id
            and any(e.requirement == change.requirement and e.expected == "violation" for e in case.expectations)
            for case in self.cases
        )

    def keep(self, change: Change) -> None:
        """Write a change into the suite."""
        self._suite = self._suite.add(
            change.scenario,
            change.requirement,
            name=change.case,
            title=change.title,
            expected=change.expected,
            reason=change.reason,
            world=self.world,
        )
        self._stamp = _stamp(self.folder)

    def _fixed(self, case: Case, result: CaseResult) -> Change:
        return Change(
            case=case.name,
            title=case.title,
            scenario=case.scenario,
            requirement=result.requirement,
            expected="pass",
            reason="",
            is_new=False,
        )

    def _failure(self, planned: Planned, result: CaseResult) -> Change:
        route = planned.scenario.mission.route.name
        case = next((case for case in self.cases if case.scenario.id == planned.scenario.id), None)
        name = f"{route}-{planned.scenario.id[-6:]}".lower()
        words = " ".join(planned.scenario.description.split()) or planned.name
        version = self.version() or planned.why.version
        driven = f" with {version}" if version else ""
        counted = f"{result.verdict.violations} of {result.verdict.runs} runs violate it"
        return Change(
            case=case.name if case else name,
            title=case.title if case else f"{route}: {words}"[:200],
            scenario=planned.scenario,
            requirement=result.requirement,
            expected="violation",
            reason=f"{counted}{driven}; a watch found it because of {planned.why.in_words}",
            is_new=True,
        )


@dataclass
class StackUnderTest:
    """The simulator with the stack under test, made again when the parameter file of the stack changes.

    Args:
        made: what a new simulator is handed to before it is used.
    """

    simulator: Simulator
    spec: str | Spec | None = None
    stack: Spec | None = None
    made: Callable[[Simulator], None] = lambda _: None
    version: str = ""
    _content: bytes | None = field(default=None, repr=False)

    @classmethod
    def of(
        cls, simulator: str | Spec | Simulator, stack: str | Spec | None, made: Callable[[Simulator], None]
    ) -> StackUnderTest:
        """Make the simulator; the stack is that of the simulator where none is given.

        Raises:
            InputError: there is no such simulator or stack, or it cannot be made with these options.
        """
        tested = None if stack is None else Spec.of(stack)
        first = make_simulator(simulator, tested)
        made(first)
        own = simulator if isinstance(simulator, str | Spec) else None
        subject = cls(first, own, tested, made)
        if tested is not None:
            subject.version, subject._content = _label(tested), _content(tested)
        return subject

    def renew(self) -> list[str]:
        """Make the simulator again if the file of the stack changed; if that fails, keep the old one and return why."""
        if self.spec is None or self.stack is None or _content(self.stack) == self._content:
            return []
        self._content = _content(self.stack)
        try:
            label = _label(self.stack)
            simulator = make_simulator(self.spec, self.stack)
            self.made(simulator)
        except RvsgError as error:
            return [f"the stack is left as it was: {error}"]
        self.close()
        self.simulator, self.version = simulator, label
        return []

    def close(self) -> None:
        """Close the simulator, unless it was given as an instance."""
        if self.spec is not None:
            self.simulator.close()


def _label(stack: Spec) -> str:
    """Return a stack as the name of a version: equal options give an equal name, whatever else the file says."""
    return f"{Path(stack.name).name} {StackChoice.of(stack).record.id[-8:]}"


def _content(stack: Spec) -> bytes | None:
    """Return the parameter file of a stack; None if it has none, or the file cannot be read at present."""
    path = Path(stack.name)
    try:
        return path.read_bytes() if path.suffix in (".yaml", ".yml") else None
    except OSError:
        return None


def _stamp(folder: Path) -> Stamp:
    files = sorted(folder.glob("*.yaml"))
    return tuple((path.name, (stat := path.stat()).st_mtime_ns, stat.st_size) for path in files)


def _world(suite: SuiteFolder) -> World:
    worlds = {world.id: world for world in suite.worlds.values()}
    if len(worlds) != 1:
        raise InputError(f"{suite.folder}: a watch needs a suite of one world, and this one has {len(worlds)}.")
    return next(iter(worlds.values()))


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
        label = self.folder / VERSION
        version = label.read_text(encoding="utf-8").strip()[:200] if label.is_file() else ""
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
        troubles, self._new = self._new, []
        return troubles

    def _recordings(self) -> Iterator[Path]:
        folders = [path.parent for path in self.folder.rglob("metadata.yaml") if not self._is_draft(path)]
        yield from folders
        for path in self.folder.rglob("*"):
            wanted = path.suffix in (".mcap", ".db3") and path.parent not in folders
            if wanted and not self._is_draft(path) and is_recording(path):
                yield path

    def _is_draft(self, path: Path) -> bool:
        return any(part.startswith(".") for part in path.relative_to(self.folder).parts)

    def _route(self, path: Path) -> str:
        names = {route.name for route in self.world.routes}
        parents = [part.name for part in path.relative_to(self.folder).parents]
        route = next((name for name in (path.stem, *parents) if name in names), None)
        if route is None:
            raise InputError(
                "which route is it? Put it into a folder named for the route of the world "
                f"({', '.join(sorted(names))}), or give --route."
            )
        return route


@dataclass
class SuiteWatch:
    """Analysis, plans and runs of a watch by the requirements and scenarios of a suite."""

    suite: LiveSuite
    rules: RuleSet
    subject: StackUnderTest
    journal: Journal
    known: Callable[..., Sequence[Entry]]
    """Returns what is known of a world, a route and a requirement; places in it are tested."""
    generator: Generator
    seed: int = 0
    jobs: int = 1

    @property
    def world(self) -> World:
        """The world of the suite."""
        return self.suite.world

    def renew(self) -> list[str]:
        """Read suite and stack again, which a person may have changed; return what could not be read, in words."""
        return [*self.suite.renew(), *self.subject.renew()]

    def analyse(self, watched: Sequence[Watched]) -> list[Sign]:
        """Return the signs of all runs, those of a new version first."""
        signs = list(self._new_version(watched))
        for run in watched:
            signs += self._limits(run)
        return signs + self._places(watched)

    def _new_version(self, watched: Sequence[Watched]) -> Iterator[Sign]:
        """Yield the version of the stack under test, or if it has none, that of the recordings."""
        seen = next((run for run in reversed(watched) if run.version), None)
        version = self.subject.version or (seen.version if seen is not None else "")
        versions = self.journal.versions
        if version and version != (versions[-1] if versions else ""):
            text = f"the stack's version is {version}, it was {versions[-1] if versions else 'unknown'}"
            symptom = Symptom(kind="new version", version=version, change=len(versions))
            yield symptom, text

    def entries(self, watched: Sequence[Watched]) -> list[Entry]:
        """Return what each run shows by each requirement."""
        entries = []
        for run in watched:
            for requirement in self._requirements(run.route).values():
                value = objective(run.run, requirement, world=self.world)
                if value is None:
                    continue
                entries.append(
                    Entry(
                        kind="watched",
                        world=self.world.name,
                        place=self.world.floor_id,
                        route=run.route,
                        requirement=requirement.name,
                        description=f"watched: {run.source}",
                        simulator=run.run.simulator,
                        verdict=judge(requirement, [value], arrived=[run.run.completed]),
                        lessons=(f"version {run.version}",) if run.version else (),
                    )
                )
        return entries

    def _requirements(self, route: str) -> dict[str, Requirement]:
        """Return the requirements on a route by their names in the suite; all of them where it has no case there."""
        cases = [case for case in self.suite.cases if case.scenario.mission.route.name == route] or self.suite.cases
        requirements = {}
        for case in cases:
            for expectation in case.expectations:
                requirements[expectation.requirement] = requirement_of(
                    expectation, self.suite.folder, self.world.route(route)
                )
        return {name: asked for name, asked in requirements.items() if asked.threshold is not None}

    def _limits(self, seen: Watched) -> Iterator[Sign]:
        for name, requirement in self._requirements(seen.route).items():
            value = objective(seen.run, requirement, world=self.world)
            if value is None or requirement.threshold is None:
                continue
            limit = requirement.threshold
            margin = requirement.badness(limit) - requirement.badness(value)
            if margin > self.rules.near * max(abs(limit), 1e-9) and not requirement.violated_by(value):
                continue
            kind = "violated" if requirement.violated_by(value) else "near its limit"
            symptom = Symptom(
                kind=kind, route=seen.route, requirement=name, version=seen.version or self.subject.version
            )
            text = f"{seen.source} on {seen.route}: {name} {kind}, {value:.3g} {requirement.unit} (limit {limit:.3g})"
            yield symptom, text

    def _places(self, watched: Sequence[Watched]) -> list[Sign]:
        """Return a sign for each route on which people were where no scenario has anybody."""
        walkable = {w.name for w in self.world.grid.waypoints if w.human}
        tested: dict[str, set[str]] = defaultdict(set)
        for case in self.suite.cases:
            tested[case.scenario.mission.route.name].update(waypoints_used(case.scenario.people))
        for entry in self.known(world=self.world.name):
            tested[entry.route].update(entry.waypoints)
        visited: dict[str, set[str]] = defaultdict(set)
        for run in watched:
            path = run.run.trajectory
            for person in range(path.human_x.shape[1]):
                near = self.world.nearest_waypoints(path.human_x[:, person], path.human_y[:, person])
                for name, count in zip(*np.unique(np.asarray(near), return_counts=True), strict=True):
                    if count >= STAYED_SAMPLES and str(name) in walkable - tested[run.route]:
                        visited[run.route].add(str(name))
        return [
            (
                Symptom(kind="never tested", route=route, places=tuple(sorted(places))),
                f"people on {route} where no scenario has anybody: {', '.join(sorted(places))}",
            )
            for route, places in sorted(visited.items())
            if places
        ]

    def plan(self, symptom: Symptom, index: int) -> list[Planned]:
        """Plan the cases for a new version, walks through untested places, else a variant by the generator."""
        if symptom.kind == "new version":
            return [self._case(symptom, case) for case in self.suite.cases]
        if symptom.kind == "never tested":
            return self._walks(symptom)
        return self._variant(symptom, index)

    def _case(self, symptom: Symptom, case: Case) -> Planned:
        return Planned(
            why=symptom,
            name=f"case {case.name}",
            scenario=case.scenario,
            requirements=tuple(expectation.requirement for expectation in case.expectations),
            runs=min(case.max_runs, self.rules.max_runs_per_plan),
            is_case=True,
        )

    def _variant(self, symptom: Symptom, index: int) -> list[Planned]:
        """Ask the generator for a scenario that differs from what is known of this route and requirement."""
        expectation = Expectation(requirement=symptom.requirement)
        route = self.world.route(symptom.route)
        requirement = requirement_of(expectation, self.suite.folder, route)
        entries = self.known(world=self.world.name, route=symptom.route, requirement=requirement.name)
        seed = seed_for(self.seed, "watch", index, 0)
        brief = single_brief(Mission.of(self.world, route), requirement, humans=2, seed=seed, feedback=None)
        scenario = self.generator.propose(brief.replace(memory=remembered(entries)[-10:]), self.world).scenario
        if scenario is None:
            return []
        name = f"variant {index}.0 for {symptom.requirement} on {symptom.route}"
        return [self._new(symptom, name, scenario, (symptom.requirement,))]

    def _walks(self, symptom: Symptom) -> list[Planned]:
        """Let somebody walk between the untested waypoints farthest apart, or to a neighbour of the only one."""
        grid = self.world.grid
        places = list(symptom.places)
        if len(places) == 1:
            places += [b if a == places[0] else a for a, b in grid.hops if places[0] in (a, b)][:1]
        pairs = [(a, b) for i, a in enumerate(places) for b in places[i + 1 :] if grid.shortest_path(a, b)]
        if not pairs:
            return []
        at = {place: np.array(grid.position(place)) for place in places}
        first, last = max(pairs, key=lambda pair: (float(np.hypot(*(at[pair[1]] - at[pair[0]]))), pair))
        route = self.world.route(symptom.route)
        person = walk("Human 1", first, last, speed_m_s=1.2).human(self.world)
        scenario = Scenario(
            mission=Mission.of(self.world, route),
            people=HumanConfiguration(humans=(person,)),
            description=f"Somebody walks between {first} and {last}: people were seen there, in no scenario.",
        )
        cases = [case for case in self.suite.cases if case.scenario.mission.route.name == route.name]
        asked = {wanted.requirement for case in cases or self.suite.cases for wanted in case.expectations}
        return [self._new(symptom, f"walk {first} to {last} on {route.name}", scenario, tuple(sorted(asked)))]

    def _new(self, why: Symptom, name: str, scenario: Scenario, requirements: tuple[str, ...]) -> Planned:
        runs = min(self.suite.head.judging.max_runs, self.rules.max_runs_per_plan)
        return Planned(why=why, name=name, scenario=scenario, requirements=requirements, runs=runs)

    def execute(self, planned: Planned) -> list[CaseResult]:
        """Run a plan until its verdicts are sure, at most the runs it was accepted with; a result per requirement."""
        kept_case = next((case for case in self.suite.cases if case.scenario == planned.scenario), None)
        expectations = kept_case.expectations if planned.is_case and kept_case else None
        case = Case(
            name=kept_case.name if planned.is_case and kept_case else "planned",
            title=planned.name[:200],
            expectations=expectations or tuple(Expectation(requirement=name) for name in planned.requirements),
            scenario=planned.scenario,
            max_runs=planned.runs,
        )
        asked = tuple(requirement_of(wanted, self.suite.folder) for wanted in case.expectations)
        wanted = SuiteCase(case=case, world=self.world, requirements=asked, judging=self.suite.head.judging)
        return list(run_cases([wanted], self.subject.simulator, jobs=self.jobs))
