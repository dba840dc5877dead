"""What a watch reads again in every cycle: the suite, which a person edits, and the stack under test."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from rvsg.api.simulating import make_simulator
from rvsg.api.suites import Suite, SuiteHead
from rvsg.campaign.suite import Case, CaseResult, State
from rvsg.campaign.watch.parts import Change, Planned
from rvsg.core.errors import InputError, RvsgError
from rvsg.core.plugins import Spec
from rvsg.simulation.protocol import Simulator
from rvsg.simulation.stacks.registry import StackChoice
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

    def __init__(self, suite: Suite, version: Callable[[], str] = lambda: "") -> None:
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
            suite = Suite.open(self.folder)
            if _world(suite).id != self.world.id:
                raise InputError("its scenarios are in another world now. Begin a new watch for that world.")
        except RvsgError as error:
            return [f"the suite is left as it was: {error}"]
        self._suite = suite
        return []

    def changes(self, planned: Planned, results: Sequence[CaseResult]) -> list[Change]:
        """Return new known failures, and cases that are fixed. A broken case stays broken: a person decides on it."""
        if planned.is_case:
            known = {case.name: case for case in self.cases}
            return [self._fixed(known[r.case], r) for r in results if r.state is State.FIXED and r.case in known]
        return [self._failure(planned, each) for each in results if each.state is State.BROKEN]

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
        known = next((case for case in self.cases if case.scenario.id == planned.scenario.id), None)
        name = f"{route}-{planned.scenario.id[-6:]}".lower()
        told = " ".join(planned.scenario.description.split()) or planned.name
        version = self.version() or planned.why.version
        driven = f" with {version}" if version else ""
        counted = f"{result.verdict.violations} of {result.verdict.runs} runs violate it"
        return Change(
            case=known.name if known else name,
            title=known.title if known else f"{route}: {told}"[:200],
            scenario=planned.scenario,
            requirement=result.requirement,
            expected="violation",
            reason=f"{counted}{driven}; a watch found it because of {planned.why.in_words}",
            is_new=True,
        )


@dataclass
class Subject:
    """The simulator with the stack under test, made again when the parameter file of the stack changes.

    Args:
        made: what a new simulator is handed to before it is used.
    """

    simulator: Simulator
    given: str | Spec | None = None
    stack: Spec | None = None
    made: Callable[[Simulator], None] = lambda _: None
    version: str = ""
    _content: bytes | None = field(default=None, repr=False)

    @classmethod
    def of(
        cls, simulator: str | Spec | Simulator, stack: str | Spec | None, made: Callable[[Simulator], None]
    ) -> Subject:
        """Make the simulator; the stack is that of the simulator where none is given.

        Raises:
            InputError: there is no such simulator or stack, or it cannot be made with these options.
        """
        spec = None if stack is None else Spec.of(stack)
        first = make_simulator(simulator, spec)
        made(first)
        given = simulator if isinstance(simulator, str | Spec) else None
        subject = cls(first, given, spec, made)
        if spec is not None:
            subject.version, subject._content = _label(spec), _content(spec)
        return subject

    def renew(self) -> list[str]:
        """Make the simulator again if the file of the stack changed; if that fails, keep the old one and return why."""
        if self.given is None or self.stack is None or _content(self.stack) == self._content:
            return []
        self._content = _content(self.stack)
        try:
            label = _label(self.stack)
            simulator = make_simulator(self.given, self.stack)
            self.made(simulator)
        except RvsgError as error:
            return [f"the stack is left as it was: {error}"]
        self.close()
        self.simulator, self.version = simulator, label
        return []

    def close(self) -> None:
        """Close the simulator, unless it was given as an instance."""
        if self.given is not None:
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


def _world(suite: Suite) -> World:
    worlds = {world.id: world for world in suite.worlds.values()}
    if len(worlds) != 1:
        raise InputError(f"{suite.folder}: a watch needs a suite of one world, and this one has {len(worlds)}.")
    return next(iter(worlds.values()))
