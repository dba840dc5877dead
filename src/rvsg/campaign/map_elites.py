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
from rvsg.campaign.hybrid import Batch, HybridStrategy
from rvsg.campaign.racing import Candidate, estimate
from rvsg.campaign.strategies import Batches


class MapElitesStrategy(HybridStrategy):
    """Fills a map of encounters with the configuration that is worst for the robot in each.

    Args:
        drafts: Share of the runs that go to first runs of new scenarios.
        repeated: Share of the runs that repeat the worst configurations of the cells.
        options: Those of `hybrid`.
    """

    name = "map-elites"
    fills_a_map = True

    def __init__(self, *args: Any, drafts: float = 0.3, repeated: float = 0.3, **options: Any) -> None:
        super().__init__(*args, drafts=drafts, **options)
        self.repeated = repeated

    def search(self) -> Batches:
        """Draft, change what is in the cells, then repeat the worst of every cell."""
        yield from self._first_drafts()
        reserve = round(self.repeated * self.plan.search_runs)
        while self.left > reserve and self.candidates:
            before, known = self.left, len(self.candidates)
            yield from self._change(min(self.batch, self.left - reserve))
            if self.left == before or len(self.candidates) == known:
                break
        yield from self._repeat()

    def _parents(self, rng: np.random.Generator, count: int) -> list[Candidate]:
        """The configurations to change: the elites of cells, each cell as likely as the other."""
        elites = list(self.elites().values())
        return [elites[int(rng.integers(len(elites)))] for _ in range(count)] if elites else []

    def _repeat(self) -> Batch:
        """Give one more run to the elites with the fewest, the worst of them first, until the budget is spent."""
        while self.left > 0:
            elites = sorted(self.elites().values(), key=lambda c: (len(self._seen(c)), -c.estimate, c.index))
            chosen = elites[: min(self.batch, self.left)]
            results = yield [self._again(c, 1) for c in chosen]
            if not results:
                return
            for attempt, candidate in zip(results, chosen, strict=False):
                self._measured(candidate, attempt)
            estimate(self.candidates)

    def _measured(self, candidate: Candidate, attempt: Attempt) -> None:
        super()._measured(candidate, attempt)
        if attempt.index != candidate.index:
            self._place(candidate, attempt)

    def _place(self, candidate: Candidate, attempt: Attempt) -> None:
        encounter = self.feedback_of(attempt, None).encounter if candidate.runs else None
        if encounter is not None:
            self._cells[candidate.index] = encounter
