"""The kinds of failure that a search has shown, and those that a configuration is expected to show.

A campaign reports distinct failures: place, what the person does, what the robot does. A search that only follows its
best configuration finds one of them over and over. `Kinds` says which configurations stand for the kinds that were
shown, which of these are not certain yet, and where nothing was found so far.
"""

from __future__ import annotations

import cmath
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from rvsg.campaign.failures import FailureMode, seen_as
from rvsg.campaign.racing import Candidate
from rvsg.evaluation.naming import place_name
from rvsg.generation.forecast import AIMED, STEP_S, Forecaster
from rvsg.scenario.scenario import HumanConfiguration
from rvsg.world.world import World

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
    return place_name(world, float(robot[at].real), float(robot[at].imag)), person
