"""The parts of sentences on a page, each with the runs that it counts, and the badges beside a verdict."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from rvsg.report.facts import RunFacts
from rvsg.report.words import shown_at


class Piece(NamedTuple):
    """A part of a sentence. With `runs` it is a link that opens them; `t_s` is the time at which it does."""

    text: str
    runs: tuple[str, ...] = ()
    t_s: float | None = None

    @property
    def address(self) -> str:
        """The part of the page's address that opens the runs in the replay."""
        if len(self.runs) == 1:
            return f"#run={self.runs[0]}" + (f"&t={shown_at(self.t_s)}" if self.t_s is not None else "")
        return "#runs=" + ",".join(self.runs)


Sentence = list[Piece]


@dataclass(frozen=True, kw_only=True)
class Badge:
    """A fact in two or three words beside the verdict. `tone` is bad, good, warn or quiet."""

    tone: str
    text: str
    runs: tuple[str, ...] = ()


def span_of(times: Sequence[float]) -> str:
    """Return between which times after the start something happens, in words."""
    low, high = min(times), max(times)
    when = f"{low:.0f} s" if round(low) == round(high) else f"{low:.0f} to {high:.0f} s"
    return f"{when} after the start"


def ids_of(runs: Iterable[RunFacts]) -> tuple[str, ...]:
    """Return the ids of runs."""
    return tuple(run.id for run in runs)
