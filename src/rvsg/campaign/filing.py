"""The attempts of a campaign as it goes on: what is asked of all of them is kept, the rest is read from the ledger.

An attempt takes some 30 kB: its scenario, every metric of every run, and all that its brief tells. A search reads
hardly any of it again, so a campaign keeps a few numbers of each attempt, and takes as much memory after 20,000 runs as
after the first thousand.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from typing import Any, cast

from rvsg.campaign.attempt import Attempt, Ledger

LAST = 256
"""Attempts kept as they are but for their brief, some 25 kB each: those made or read last."""
LAST_BRIEFS = 4
"""Attempts kept with their brief, some 0.5 MB each where it tells of measurements."""
ASKED_OFTEN = (
    "index",
    "purpose",
    "confirms",
    "mean",
    "runs",
    "scenario_index",
    "scenario_id",
    "untold_id",
    "lesson",
    "seeds",
    "measured_runs",
    "violations",
    "valued_runs",
)


class Filed:
    """An Attempt of the ledger. Whatever it does not hold itself is read from there."""

    __slots__ = (*ASKED_OFTEN, "_filing")

    def __init__(self, attempt: Attempt, filing: Filing) -> None:
        self._filing = filing
        for name in ASKED_OFTEN:
            setattr(self, name, getattr(attempt, name))

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return getattr(self._filing.read(cast(int, self.index), but_brief=name in _BUT_BRIEF), name)

    def __eq__(self, other: object) -> bool:
        if self is other:
            return True
        same = isinstance(other, Attempt | Filed) and self.index == other.index
        return same and bool(whole(cast(Attempt, self)) == whole(cast(Attempt, other)))

    __hash__ = None  # type: ignore[assignment]


_BUT_BRIEF = frozenset(Attempt.model_fields) - {"brief"}


def whole(attempt: Attempt) -> Attempt:
    """Return the record itself of an attempt that is possibly filed, for those who keep or serialise it."""
    return attempt._filing.read(attempt.index) if isinstance(attempt, Filed) else attempt


class Filing:
    """Files the attempts of a campaign.

    Args:
        ledger: Where they are stored. One that has no method `attempt`, or keeps everything in memory, is not read
            again; then attempts are kept as they are.
    """

    def __init__(self, ledger: Ledger, campaign: str) -> None:
        self._reads: Callable[[str, int], Attempt] | None = getattr(ledger, "attempt", None)
        self._campaign = campaign
        self._last: OrderedDict[int, Attempt] = OrderedDict()
        self._briefs: OrderedDict[int, Attempt] = OrderedDict()

    def __call__(self, attempt: Attempt) -> Attempt:
        """Return what stands for a stored attempt."""
        if self._reads is None:
            return attempt
        self._keep(attempt)
        return cast(Attempt, Filed(attempt, self))

    def read(self, index: int, *, but_brief: bool = False) -> Attempt:
        """Return an attempt.

        Args:
            but_brief: Nobody asks for its brief.
        """
        kept = self._last if but_brief else self._briefs
        if index not in kept:
            assert self._reads is not None
            self._keep(self._reads(self._campaign, index))
        kept.move_to_end(index)
        return kept[index]

    def _keep(self, attempt: Attempt) -> None:
        self._briefs[attempt.index] = attempt
        self._last[attempt.index] = attempt.model_copy(update={"brief": None})
        for kept, most in ((self._last, LAST), (self._briefs, LAST_BRIEFS)):
            if len(kept) > most:
                kept.popitem(last=False)
