"""Make new configurations from good ones: change numbers of one, or put a person of another into it.

Of several changes the one is taken that the forecast, weighed by what the campaign measured so far, expects to be
worst for the robot.
"""

from __future__ import annotations

from collections.abc import Sequence, Set
from itertools import islice
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rvsg.campaign.kinds import Met, foreseen
from rvsg.campaign.racing import Candidate
from rvsg.campaign.surrogate import Surrogate
from rvsg.core.records import Record, text_id
from rvsg.generation.descriptions import Described, describe_changed, describe_tuned, same_work, tells_of
from rvsg.generation.forecast import Screen
from rvsg.generation.search_space import Mutations, TuningSpace
from rvsg.generation.workplaces import handles_goods, places_of
from rvsg.scenario.placement import start_gap_m
from rvsg.scenario.requirement import Aim
from rvsg.scenario.rules import START_CLEARANCE_M
from rvsg.scenario.scenario import HumanConfiguration, Mission, Scenario
from rvsg.scenario.validity import check
from rvsg.world.world import World

OPTIONS = 16
"""The number of changes forecast for every one that is run."""
SHORTLIST = 2
"""One of this many most promising changes is run, since the forecast is rough."""
SPACES = 64
"""Search spaces that are kept, of the configurations changed last."""
CROSSED = 0.15
"""How often a person of another configuration is put into one, where both have several people."""


class Change(Record):
    """A changed configuration, with what changed in words."""

    people: HumanConfiguration
    described: Described
    words: str


class _Option(NamedTuple):
    """A change that may be chosen."""

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
            known: Keys of configurations that were tried, as `key` makes them.
            avoid: Where and how nobody should meet the robot, if the forecast sees another way.
        """
        options: dict[str, _Option] = {}
        for _ in range(OPTIONS):
            crossed = rng.random() < CROSSED
            made = self._crossed(parent, others, rng) if crossed else self._tuned(parent, rng)
            if made is not None and (new := key(made.people)) not in known:
                options.setdefault(new, made)
        if not options:
            return None
        changes = list(options.values())
        surrogate = Surrogate(others, np.array([self._features_of(c) for c in others]))
        gains = surrogate.differences(self._screen([c.people for c in changes]), self._features_of(parent))
        order = [int(k) for k in np.argsort(-np.round(gains / (np.abs(gains).max() or 1.0), 6), kind="stable")]
        best = self._shortlist([changes[k] for k in order], avoid)
        chosen = best[int(rng.integers(len(best)))]
        return Change(people=chosen.people, described=self._described(parent.scenario, chosen), words=chosen.words)

    def _described(self, before: Scenario, option: _Option) -> Described:
        if option.written:
            return describe_changed(before, option.people.humans, goods=self._goods)
        return describe_tuned(before, option.people, goods=self._goods)

    def _shortlist(self, ranked: Sequence[_Option], avoid: Set[Met]) -> Sequence[_Option]:
        """Return the first of some changes, of those that leave the ways of meeting to avoid where there are such."""
        leaves = (
            option
            for option in ranked
            if foreseen(self._screen.forecaster, [option.people], self.world)[0] not in avoid
        )
        return (list(islice(leaves, SHORTLIST)) if avoid else []) or ranked[:SHORTLIST]

    def _tuned(self, parent: Candidate, rng: np.random.Generator) -> _Option | None:
        scenario = parent.scenario
        space = self._spaces.get(parent.index)
        if space is None:
            if len(self._spaces) == SPACES:
                del self._spaces[next(iter(self._spaces))]
            space = self._spaces[parent.index] = TuningSpace(scenario.people, self.mission, self.world)
        people, words = Mutations(space, rng).draw()
        if people is None:
            return None
        return _Option(people, f"with other numbers: {words}")

    def _crossed(self, parent: Candidate, others: Sequence[Candidate], rng: np.random.Generator) -> _Option | None:
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
        if lent.group is not None or humans[out].group is not None or not (ours or same_work(humans[out], lent)):
            return None
        new = lent.model_copy(update={"name": humans[out].name})
        people = HumanConfiguration(humans=(*humans[:out], new, *humans[out + 1 :]))
        if not self._starts_clear(people) or check(people, self.mission, self.world):
            return None
        return _Option(people, f"with {lent.name} of attempt {lender.index} as {new.name}", written=ours)

    def _starts_clear(self, people: HumanConfiguration) -> bool:
        starts = [(human.radius_m, human.starts_at(self.world.grid)) for human in people.humans]
        return all(at is None or start_gap_m(r, at, self.mission) >= START_CLEARANCE_M for r, at in starts)

    def _features_of(self, candidate: Candidate) -> NDArray[np.float64]:
        if candidate.index not in self._features:
            self._features[candidate.index] = self._screen([candidate.scenario.people])[0]
        return self._features[candidate.index]


def key(people: HumanConfiguration) -> str:
    """Return what tells configurations apart, whatever their description."""
    return text_id("people", people.model_dump_json())
