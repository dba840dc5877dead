"""The multi strategy: several requirements at once. It looks for the Pareto front instead of one worst configuration.

It drafts and changes as `hybrid` does. What is changed is on the front, one configuration as likely as the other, or
would be among the next ones without it; at the end the front is run again.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rvsg.campaign.keeping import KeepingStrategy
from rvsg.campaign.pareto import Tried, tried_by, undominated
from rvsg.campaign.racing import Candidate

KEEN = 0.6
"""How often what is changed is on the first front; with as much of what is left on the next, and so on."""


class MultiStrategy(KeepingStrategy):
    """Fills the Pareto front of the plan's requirement and those in `plan.also`.

    Args:
        drafts: Share of the runs that go to first runs of new scenarios.
        repeated: Share of the runs that repeat what is on the front.
        options: Those of `hybrid`.
    """

    name = "multi"
    needs_several = True

    def __init__(self, *args: Any, drafts: float = 0.2, repeated: float = 0.4, **options: Any) -> None:
        super().__init__(*args, drafts=drafts, repeated=repeated, **options)
        self._known: dict[int, tuple[Tried, ...] | None] = {}

    def fronts(self) -> list[list[Candidate]]:
        """Return the candidates front by front: those that none beats, those that none of the others beats, ..."""
        known = [(c, tried) for c in self.candidates if (tried := self._tried_by(c)) is not None]
        shares = np.array([[each.share for each in tried] for _, tried in known])
        left, found = list(range(len(known))), []
        while left:
            front = {left[k] for k in undominated(shares[left])}
            found.append([known[k][0] for k in sorted(front)])
            left = [k for k in left if k not in front]
        return found

    def _tried_by(self, candidate: Candidate) -> tuple[Tried, ...] | None:
        if not candidate.runs:
            return None
        last = candidate.last.index
        if last not in self._known:
            self._known[last] = tried_by(candidate.last.measurements, self.plan)
        return self._known[last]

    def _parents(self, rng: np.random.Generator, count: int) -> list[Candidate]:
        fronts = self.fronts()
        chosen = []
        for _ in range(count if fronts else 0):
            front = fronts[min(len(fronts), int(rng.geometric(KEEN))) - 1]
            chosen.append(front[int(rng.integers(len(front)))])
        return chosen

    def _kept(self) -> list[Candidate]:
        """Return the front, those with the fewest runs first."""
        fronts = self.fronts()
        return sorted(fronts[0] if fronts else [], key=lambda c: (len(self._seen(c)), c.index))
