"""Mutation: new configurations made from good ones, and the kinds of failure that guide which.

An operator changes the numbers of one configuration, or puts a person of another into it. Of several changes the one is
run that the forecast, weighed by what the campaign measured so far, expects to be worst for the robot.
"""

from __future__ import annotations

import cmath
from collections import Counter
from collections.abc import Generator, Iterable, Mapping, Sequence, Set
from itertools import islice
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rvsg.core.seeds import seed_for
from rvsg.evaluation.signals import aim_of
from rvsg.findings.feedback import FeedbackSource
from rvsg.findings.ranking import badness_of
from rvsg.generation.descriptions import Described, answer, describe_changed, describe_tuned, same_work, tells_of
from rvsg.generation.forecast import AIMED, STEP_S, Forecaster, Screen
from rvsg.generation.people_sampler import added
from rvsg.generation.search_space import Mutations, TuningSpace
from rvsg.generation.workplaces import handles_goods, places_of
from rvsg.runs.attempt import Attempt, Plan
from rvsg.runs.observation import FailureMode, acting, seen_as
from rvsg.scenario.brief import Brief, Encounter
from rvsg.scenario.placement import start_gap_m
from rvsg.scenario.requirement import Aim
from rvsg.scenario.rules import START_CLEARANCE_M
from rvsg.scenario.scenario import HumanConfiguration, Mission, Scenario
from rvsg.scenario.validity import check
from rvsg.search.candidates import TUNED, Candidate
from rvsg.search.race import estimate
from rvsg.search.strategies import Ask, BatchStrategy, brief_of
from rvsg.world.world import World

Floats = NDArray[np.float64]

FEWEST = 8
"""Candidates needed for a model."""
RIDGE = 3.0
"""Strength of the penalty, in candidates; features have unit variance."""


def surrogate(candidates: Sequence[Candidate], features: Floats) -> Floats:
    """Fit a linear model of badness to candidates with runs, `features` (N, F); return its weights (F,)."""
    count = features.shape[1]
    if len(candidates) < FEWEST:
        return np.zeros(count)
    spread = features.std(axis=0)
    scale = np.where(spread > 1e-9, spread, np.inf)
    rows = (features - features.mean(axis=0)) / scale
    values = np.array([candidate.estimate for candidate in candidates])
    values = values - values.mean()
    return np.asarray(np.linalg.solve(rows.T @ rows + RIDGE * np.eye(count), rows.T @ values) / scale)


Met = tuple[str, str]
"""A place, and where a person is there and how they move: what a forecast can tell of a kind of failure."""
CERTAIN = 2
"""So many runs that show a kind of failure, and none that does not, make it certain enough for a confirmation."""


class Kinds:
    """The kinds of failure that the candidates of one search show.

    Args:
        limit: The badness beyond which the requirement is violated.
    """

    def __init__(self, limit: float) -> None:
        self.limit = limit
        self._modes: dict[int, Counter[FailureMode]] = {}

    def place(self, candidate: Candidate, modes: Iterable[FailureMode]) -> None:
        """Note how the violating runs of a candidate fail."""
        self._modes[candidate.index] = Counter(modes)

    def champions(self, candidates: Sequence[Candidate]) -> dict[FailureMode, Candidate]:
        """Return for each kind the candidate that shows it most surely; the worst for the robot of equals."""
        found: dict[FailureMode, Candidate] = {}
        for candidate in candidates:
            for mode in self._modes.get(candidate.index, ()):
                if mode not in found or self._rank(candidate, mode) > self._rank(found[mode], mode):
                    found[mode] = candidate
        return found

    def doubtful(self, candidates: Sequence[Candidate]) -> list[Candidate]:
        """Return the champions of kinds that one run alone shows, those of the kinds tried least often first.

        One more run makes the kind certain, or shows that the candidate fails in more than one way. A kind was tried
        by every candidate with several runs that shows it. Candidates that violate beyond doubt, as the runs of related
        ones tell, need no second run.
        """
        tried = Counter(mode for c in candidates if c.runs >= CERTAIN for mode in self._modes.get(c.index, ()))
        met: Counter[Met] = Counter()
        for mode, count in tried.items():
            met[mode.place, mode.person] += count
        open_ = [
            (tried[mode], met[mode.place, mode.person], -c.estimate, c.index, c)
            for mode, c in self.champions(candidates).items()
            if self._modes[c.index][mode] == c.runs < CERTAIN and c.lower <= self.limit
        ]
        return list({each[-1].index: each[-1] for each in sorted(open_, key=lambda each: each[:4])}.values())

    def least_changed(self, candidates: Sequence[Candidate], changes: Mapping[int, int]) -> Candidate | None:
        """Return the champion that shows its kind most surely and was changed least often.

        Args:
            changes: How often each candidate was changed, by its index.
        """
        _, best = max(
            self.champions(candidates).items(),
            key=lambda pair: (
                self.surely(pair[1], pair[0]) / (1.0 + changes.get(pair[1].index, 0)),
                pair[1].estimate,
                -pair[1].index,
            ),
            default=(None, None),
        )
        return best

    def met(self) -> set[Met]:
        """Return the places and persons of all kinds that were shown."""
        return {(mode.place, mode.person) for modes in self._modes.values() for mode in modes}

    def surely(self, candidate: Candidate, mode: FailureMode) -> float:
        """Return the share of runs that show a kind, pulled towards one half by one run that does and one that not."""
        return (self._modes[candidate.index][mode] + 1.0) / (candidate.runs + 2.0)

    def _rank(self, candidate: Candidate, mode: FailureMode) -> tuple[float, float, int]:
        return (self.surely(candidate, mode), candidate.estimate, -candidate.index)


def foreseen(forecaster: Forecaster, configurations: Sequence[HumanConfiguration], world: World) -> list[Met | None]:
    """Return where and how the forecast expects the closest approach of each configuration; None without people."""
    found: list[Met | None] = [None] * len(configurations)
    sizes: dict[int, list[int]] = {}
    for k, people in enumerate(configurations):
        sizes.setdefault(min(AIMED, len(people.humans)), []).append(k)
    for size, members in sizes.items():
        if size:
            tracks = forecaster.tracks([configurations[k].humans[:size] for k in members])
            for k, track in zip(members, tracks, strict=True):
                found[k] = _closest(track, world)
    return found


def _closest(track: NDArray[np.complex128], world: World) -> Met | None:
    """Place and person of the closest approach of a track, (N, 1 + H)."""
    if len(track) < 2:
        return None
    robot, people = track[:, 0], track[:, 1:]
    at, human = (int(k) for k in np.unravel_index(int(np.abs(people - robot[:, None]).argmin()), people.shape))
    moved = np.diff(robot)
    driving = np.flatnonzero(np.abs(moved) > 1e-6)
    heading = moved[driving[min(len(driving) - 1, int(np.searchsorted(driving, at)))]] if len(driving) else 1.0
    apart, second = complex(people[at, human] - robot[at]), max(0, at - round(1.0 / STEP_S))
    velocity = complex(people[at, human] - people[second, human]) / max((at - second) * STEP_S, STEP_S)
    person = seen_as((apart.real, apart.imag), (velocity.real, velocity.imag), cmath.phase(heading))
    return world.place_name(float(robot[at].real), float(robot[at].imag)), person


OPTIONS = 16
"""The number of changes forecast for every one that is run."""
SHORTLIST = 2
"""One of this many most promising changes is run, since the forecast is rough."""
SPACES = 64
"""Search spaces that are kept, of the configurations changed last."""
CROSSED = 0.15
"""How often a person of another configuration is put into one, where both have several people."""


class Change(NamedTuple):
    """A changed configuration, with what changed in words."""

    people: HumanConfiguration
    words: str
    written: bool = False
    """A person of another scenario came in, and the text is written anew for all."""


class Operators:
    """Changes candidates of one campaign. Everything random comes from the generator of the call."""

    def __init__(self, mission: Mission, world: World, aim: Aim | None) -> None:
        self.mission, self.world = mission, world
        self._screen = Screen(mission, world, aim or Aim.SHARE)
        self._goods = handles_goods(places_of(world, reachable_from=mission.route.start))
        self._spaces: dict[int, TuningSpace] = {}
        self._features: dict[int, NDArray[np.float64]] = {}

    def change(
        self,
        parent: Candidate,
        others: Sequence[Candidate],
        rng: np.random.Generator,
        known: set[str],
        avoid: Set[Met] = frozenset(),
    ) -> Change | None:
        """Return a changed configuration of the parent that was not tried; None if none is found.

        Args:
            others: The candidates with runs, which teach the forecast and lend people.
            known: Situations that were tried.
            avoid: Where and how nobody should meet the robot, if the forecast sees another way.
        """
        options: dict[str, Change] = {}
        for _ in range(OPTIONS):
            crossed = rng.random() < CROSSED
            made = self._crossed(parent, others, rng) if crossed else self._tuned(parent, rng)
            if made is not None and (new := _situation(made, parent)) not in known and self._acts(made, parent):
                options.setdefault(new, made)
        if not options:
            return None
        changes = list(options.values())
        weights = surrogate(others, np.array([self._features_of(c) for c in others]))
        gains = (self._screen([c.people for c in changes]) - self._features_of(parent)) @ weights
        order = [int(k) for k in np.argsort(-np.round(gains / (np.abs(gains).max() or 1.0), 6), kind="stable")]
        ranked = [changes[k] for k in order]
        leaves = (c for c in ranked if foreseen(self._screen.forecaster, [c.people], self.world)[0] not in avoid)
        best = (list(islice(leaves, SHORTLIST)) if avoid else []) or ranked[:SHORTLIST]
        return best[int(rng.integers(len(best)))]

    def _acts(self, change: Change, parent: Candidate) -> bool:
        """Whether a change acts before the runs of its parent are decided; else they would end as the parent's did."""
        grid = self.world.grid
        before = acting(parent.scenario.people, grid, parent.decided)
        return acting(change.people, grid, parent.decided) != before

    def describe(self, before: Scenario, change: Change) -> Described:
        """Return the description of a changed scenario."""
        if change.written:
            return describe_changed(before, change.people.humans, goods=self._goods)
        return describe_tuned(before, change.people, goods=self._goods)

    def _tuned(self, parent: Candidate, rng: np.random.Generator) -> Change | None:
        space = self._spaces.get(parent.index)
        if space is None:
            if len(self._spaces) == SPACES:
                del self._spaces[next(iter(self._spaces))]
            limits = parent.attempt.proposal.limits
            space = TuningSpace(parent.scenario.people, self.mission, self.world, limits)
            self._spaces[parent.index] = space
        people, words = Mutations(space, rng).draw()
        return None if people is None else Change(people, f"with other numbers: {words}")

    def _crossed(self, parent: Candidate, others: Sequence[Candidate], rng: np.random.Generator) -> Change | None:
        """Replace one person of the parent by one of another scenario.

        A text that a model wrote cannot be written again. There, only a person with the same name and tasks, of
        another configuration of the scenario, takes the place, so that the text stays true.
        """
        humans = parent.scenario.people.humans
        ours = tells_of(parent.scenario, goods=self._goods)
        own = parent.scenario_index
        lenders = [c for c in others if (c.scenario_index != own) == ours and c is not parent]
        if len(humans) < 2 or not lenders:
            return None
        ranked = sorted(lenders, key=lambda c: (-c.estimate, c.index))
        lender = ranked[min(len(ranked), int(rng.geometric(0.3))) - 1]
        out, into = int(rng.integers(len(humans))), int(rng.integers(len(lender.scenario.people.humans)))
        lent = lender.scenario.people.humans[into]
        if humans[out].name in parent.attempt.proposal.limits:
            return None
        if lent.group is not None or humans[out].group is not None or not (ours or same_work(humans[out], lent)):
            return None
        new = lent.model_copy(update={"name": humans[out].name})
        people = HumanConfiguration(humans=(*humans[:out], new, *humans[out + 1 :]))
        starts = [(human.body_radius_m, human.starts_at(self.world.grid)) for human in people.humans]
        near = any(at is not None and start_gap_m(r, at, self.mission) < START_CLEARANCE_M for r, at in starts)
        if near or check(people, self.mission, self.world):
            return None
        return Change(people, f"with {lent.name} of attempt {lender.index} as {new.name}", written=ours)

    def _features_of(self, candidate: Candidate) -> NDArray[np.float64]:
        if candidate.index not in self._features:
            self._features[candidate.index] = self._screen([candidate.scenario.people])[0]
        return self._features[candidate.index]


class CandidateStrategy(BatchStrategy):
    """A batch strategy whose configurations are candidates of one race; subclasses implement `search`.

    Args:
        final_runs: Runs of a configuration that is measured in full.
    """

    def __init__(
        self, plan: Plan, feedback_of: FeedbackSource, world: World | None = None, *, final_runs: int = 10
    ) -> None:
        super().__init__(plan, feedback_of, world)
        if world is None:
            raise ValueError(f"the {self.name} strategy needs the world")
        self.here = world
        self.final_runs = final_runs
        self.candidates: list[Candidate] = []
        self.asked = 0
        self._numbers: dict[int, int] = {}
        self._cells: dict[int, Encounter] = {}
        self._by_id: dict[str, Candidate] = {}
        self._keys: set[str] = set()
        self._operators = Operators(plan.mission, world, aim_of(plan.requirement))

    @property
    def measured(self) -> list[Candidate]:
        """The candidates that have runs."""
        return [candidate for candidate in self.candidates if candidate.runs]

    def _brief(self, kind: str, scenario: int, configuration: int, **more: object) -> Brief:
        self.asked += 1
        self._numbers[scenario] = max(configuration, self._numbers.get(scenario, 0))
        tunes = self.plan.proposals is not None
        return brief_of(self.plan, kind, self.asked - 1, (scenario, configuration), tunes=tunes, **more)

    def _changed(
        self,
        parent: Candidate,
        rng: np.random.Generator,
        known: set[str],
        seeds: tuple[int, ...],
        avoid: Set[Met] = frozenset(),
    ) -> Ask | None:
        """The ask for a changed configuration that was not tried yet; None where none is found."""
        change = self._operators.change(parent, self.measured, rng, known, avoid)
        if change is None:
            return None
        known.add(_situation(change, parent))
        brief = self._brief("tune", parent.scenario_index, self._next(parent))
        proposal = answer(
            change.people,
            brief,
            self.here,
            generator=self.name,
            described=self._operators.describe(parent.scenario, change),
            reasoning=f"Attempt {parent.index} {change.words}.",
            moved=added(self.plan.mission, parent.scenario.mission),
        )
        proposal = proposal.replace(limits=parent.attempt.proposal.limits)
        return Ask(brief=brief, proposal=proposal, seeds=seeds) if proposal.scenario else None

    def _again(self, candidate: Candidate, runs: int) -> Ask:
        """The ask for more runs of a candidate, on the first seeds of the race that it did not meet."""
        attempt, seen = candidate.attempt, candidate.last.seeds
        more = [seed for seed in self._seeds(len(seen) + runs + self.final_runs) if seed not in seen]
        return Ask(brief=attempt.brief, proposal=attempt.proposal, seeds=(*seen, *more[:runs]))

    def _seeds(self, count: int) -> tuple[int, ...]:
        return tuple(seed_for(self.plan.seed, "race", k) for k in range(count))

    def _next(self, parent: Candidate) -> int:
        return 1 + self._numbers[parent.scenario_index]

    def _run_again(self, asks: list[Ask], candidates: Sequence[Candidate]) -> Generator[list[Ask], list[Attempt], bool]:
        """Make further runs of candidates, estimate all anew, and return whether any run was left to make."""
        results = yield asks
        for attempt, candidate in zip(results, candidates, strict=False):
            self._measured(candidate, attempt)
        estimate(self.candidates)
        return bool(results)

    def _add(self, attempt: Attempt, parent: Candidate | None, operator: str) -> None:
        """Keep a new candidate, unless the same configuration is in the race already."""
        scenario = attempt.proposal.scenario
        if scenario is None:
            return
        if (known := self._by_id.get(scenario.id)) is not None:
            if known.attempt.scenario_id == scenario.id:
                known.last = attempt
            return
        if operator != TUNED and (twin := self._twin(attempt, scenario)) is not None:
            twin.repeats.append(attempt.index)
            twin.badness = badness_of(attempt, self.plan.requirement) | twin.badness
            self._by_id[scenario.id] = twin
            self._keys.add(scenario.situation)
            return
        candidate = self._by_id[scenario.id] = Candidate(attempt, parent, operator)
        self.candidates.append(candidate)
        self._keys.add(scenario.situation)
        self._measured(candidate, attempt)
        self._place(candidate, attempt)

    def _twin(self, attempt: Attempt, scenario: Scenario) -> Candidate | None:
        """Return a candidate of the same scenario whose runs so far, and this attempt's, are runs of both."""
        reached = self.feedback_of.reached(attempt)
        own = (c for c in self.measured if c.scenario_index == attempt.scenario_index)
        return next((c for c in own if all(_alike(c, scenario, self.here, r) for r in (reached, c.reached))), None)

    def _place(self, candidate: Candidate, attempt: Attempt) -> None:
        encounter = self.feedback_of.encounter(attempt) if candidate.runs else None
        if encounter is not None:
            self._cells[candidate.index] = encounter.replace(stretch="", who="")

    def _measured(self, candidate: Candidate, attempt: Attempt) -> None:
        candidate.badness |= badness_of(attempt, self.plan.requirement)
        candidate.reached = self.feedback_of.reached(attempt)
        # One moment decides the runs only where all of them fail at the closest approach.
        failed = len(attempt.violating(self.plan.requirement)) == len(attempt.measurements)
        meets = aim_of(self.plan.requirement) is Aim.MEET
        decided = self.feedback_of.reached(attempt, before_closest=True) if failed and meets else candidate.reached
        candidate.decided = decided

    def tell(self, attempt: Attempt) -> None:
        """Receive an attempt of the current batch."""
        super().tell(attempt)
        candidate = self._by_id.get(attempt.scenario_id or "")
        if candidate is not None and candidate.attempt.scenario_id == attempt.scenario_id:
            candidate.last = self.attempts[-1]


def _situation(change: Change, parent: Candidate) -> str:
    """Return the situation of a changed configuration, among the objects of its parent."""
    return parent.scenario.model_copy(update={"people": change.people}).situation


def _alike(candidate: Candidate, scenario: Scenario, world: World, reached: Mapping[str, int]) -> bool:
    """Whether two configurations are the same as far as anything acts while people reach these goals."""
    people, others = candidate.scenario.people, scenario.people
    same_mission = candidate.scenario.mission == scenario.mission
    return same_mission and acting(people, world.grid, reached) == acting(others, world.grid, reached)
