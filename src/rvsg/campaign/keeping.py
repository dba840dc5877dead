"""What `map-elites` and `multi` have in common: they keep several configurations, change those, and repeat them."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar

from rvsg.campaign.hybrid import Batch, HybridStrategy
from rvsg.campaign.racing import Candidate, estimate
from rvsg.campaign.strategies import Batches


class KeepingStrategy(HybridStrategy):
    """Drafts, changes what it keeps, then repeats what it keeps until the budget is spent.

    Args:
        repeated: Share of the runs that repeat what is kept.
        options: Those of `hybrid`.
    """

    recorded: ClassVar[Mapping[str, Any]] = {}
    unrecorded: ClassVar[Mapping[str, Any]] = {}

    def __init__(self, *args: Any, repeated: float, **options: Any) -> None:
        super().__init__(*args, spread=False, **options)
        self.repeated = repeated

    @abstractmethod
    def _kept(self) -> list[Candidate]:
        """Return the configurations that are kept, the one to run again first at the front."""

    def search(self) -> Batches:
        """Draft; change what is kept; then repeat it until the budget is spent."""
        yield from self._first_drafts()
        reserve = round(self.repeated * self.plan.search_runs)
        while self.left > reserve and self.candidates:
            before, known = self.left, len(self.candidates)
            yield from self._change(min(self.batch, self.left - reserve))
            if self.left == before or len(self.candidates) == known:
                break
        yield from self._repeat()

    def _repeat(self) -> Batch:
        """Give one more run to the first of those that are kept, until the budget is spent."""
        while self.left > 0:
            chosen = self._kept()[: min(self.batch, self.left)]
            results = yield [self._again(c, 1) for c in chosen]
            if not results:
                return
            for attempt, candidate in zip(results, chosen, strict=False):
                self._measured(candidate, attempt)
            estimate(self.candidates)
