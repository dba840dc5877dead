"""The map-elites strategy: the worst configuration for every kind of encounter, instead of one worst configuration.

Configurations are sorted into cells by their closest approach: on which third of its way the robot is, near which
area, who is nearest, and how that person moves (Mouret and Clune 2015, "Illuminating search spaces by mapping elites").
Every cell is as likely to lend the configuration that is changed next, and a change that leads into another cell
fills that one. At the end the worst configuration of every cell is repeated.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rvsg.campaign.attempt import Attempt
from rvsg.campaign.keeping import KeepingStrategy
from rvsg.campaign.racing import Candidate


class MapElitesStrategy(KeepingStrategy):
    """Fills a map of encounters with the configuration that is worst for the robot in each.

    Args:
        drafts: Share of the runs that go to first runs of new scenarios.
        repeated: Share of the runs that repeat the worst configurations of the cells.
        options: Those of `hybrid`.
    """

    name = "map-elites"
    fills_a_map = True

    def __init__(self, *args: Any, drafts: float = 0.3, repeated: float = 0.3, **options: Any) -> None:
        super().__init__(*args, drafts=drafts, repeated=repeated, **options)

    def _parents(self, rng: np.random.Generator, count: int) -> list[Candidate]:
        """Return the configurations to change: the elites of cells, each cell as likely as the other."""
        elites = list(self.elites().values())
        return [elites[int(rng.integers(len(elites)))] for _ in range(count)] if elites else []

    def _kept(self) -> list[Candidate]:
        """Return the elites, those with the fewest runs first, the worst of them before the others."""
        return sorted(self.elites().values(), key=lambda c: (len(self._seen(c)), -c.estimate, c.index))

    def _measured(self, candidate: Candidate, attempt: Attempt) -> None:
        super()._measured(candidate, attempt)
        if attempt.index != candidate.index:
            self._place(candidate, attempt)

    def _place(self, candidate: Candidate, attempt: Attempt) -> None:
        encounter = self.encounter_of(attempt) if candidate.runs else None
        if encounter is not None:
            self._cells[candidate.index] = encounter
