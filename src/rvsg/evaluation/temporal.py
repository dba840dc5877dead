"""Signal temporal logic over sampled signals, with exact quantitative robustness.

A formula has a value at each sample: how far the run is from breaking it (positive) or how badly it breaks it
(negative), in the unit of the compared signal (Donze and Maler 2010). Over samples at t_0 < t_1 < ... < t_n:

    a > b, a >= b            a - b                    a < b, a <= b            b - a
    not f                    -f                       f implies g              max(-f, g)
    f and g                  min(f, g)                f or g                   max(f, g)
    always[p,q] f            the smallest f(t) with t in [t_k + p, t_k + q]
    eventually[p,q] f        the largest f(t) there
    f until[p,q] g           the largest over t' in [t_k + p, t_k + q] of min(g(t'), the smallest f from t_k to
                             before t')

Without an interval it is [0, inf]. Samples after the end of the run do not exist: `always` over none of them holds
(+inf), `eventually` and `until` over none of them fail (-inf). Bounds take in samples within a nanosecond.

Parser of temporal formulas. An error names the position.

    always (distance_to_person > 0.5 or speed < 0.1)
    always (distance_to_person < 0.8 implies eventually[0, 2] speed < 0.3)
    speed < 0.2 until distance_to_person > 1.0

From loosest to tightest: implies (to the right), or, and, until; then not, always, eventually, each of which takes
the next comparison or parenthesis alone; then < <= > >=; then + -, * /, -x. Functions: abs(x), min(x, y), max(x, y).
Intervals are in seconds: always[0, 5], eventually[1, inf]. A formula is data: nothing in it is executed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rvsg.core.errors import InputError

Floats = NDArray[np.float64]
Range = tuple[float, float]
TOLERANCE_S = 1e-9


@dataclass(frozen=True)
class Interval:
    """Seconds from now, both ends included; `high` may be infinite."""

    low: float = 0.0
    high: float = float("inf")

    @property
    def is_everything(self) -> bool:
        """Return whether it reaches from now to the end."""
        return self.low == 0.0 and self.high == float("inf")

    def samples(self, time: Floats) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Return for each sample the first index inside the interval and the first one after it."""
        first = np.searchsorted(time, time + self.low - TOLERANCE_S, side="left")
        after = np.searchsorted(time, time + self.high + TOLERANCE_S, side="right")
        return first, np.maximum(first, after)


@dataclass(frozen=True)
class Node:
    """A part of a formula: a number, a signal, or an operation on other parts."""

    kind: str
    """`number`, `signal`, `always`, `eventually`, `until`, or a key of `POINTWISE`."""
    parts: tuple[Node, ...] = ()
    interval: Interval = Interval()
    value: float = 0.0
    """Of a number."""
    name: str = ""
    """Of a signal."""

    def __str__(self) -> str:
        """Return the part as a formula."""
        words = [str(part) for part in self.parts]
        within = "" if self.interval.is_everything else f"[{self.interval.low:g}, {self.interval.high:g}]"
        match self.kind:
            case "number":
                return f"{self.value:g}"
            case "signal":
                return self.name
            case "min" | "max" | "abs":
                return f"{self.kind}({', '.join(words)})"
            case "not" | "always" | "eventually" | "negative":
                return f"{'-' if self.kind == 'negative' else f'{self.kind}{within} '}{words[0]}"
            case kind:
                return f"({words[0]} {'>' if kind == 'room' else kind + within} {words[1]})"

    def values(self, time: Floats, signals: Mapping[str, Floats]) -> Floats:
        """Return (N,) the value at each of the N samples."""
        parts = [part.values(time, signals) for part in self.parts]
        match self.kind:
            case "number":
                return np.full(len(time), self.value)
            case "signal":
                return np.asarray(signals[self.name], dtype=np.float64)
            case "always":
                return _smallest(parts[0], self.interval, time)
            case "eventually":
                return -_smallest(-parts[0], self.interval, time)
            case "until":
                return _until(parts[0], parts[1], self.interval, time)
            case kind:
                return POINTWISE[kind](*parts)


def bounds(node: Node, ranges: Callable[[str], Range]) -> Range:
    """Return a range that holds every value a formula can have, by interval arithmetic.

    Args:
        ranges: returns the range of a signal.
    """
    parts = [bounds(part, ranges) for part in node.parts]
    (low, high), (other_low, other_high) = parts[0] if parts else (0.0, 0.0), parts[-1] if parts else (0.0, 0.0)
    match node.kind:
        case "number":
            return node.value, node.value
        case "signal":
            return ranges(node.name)
        case "+":
            return low + other_low, high + other_high
        case "-" | "room":
            return low - other_high, high - other_low
        case "negative" | "not":
            return -high, -low
        case "abs":
            return max(0.0, low, -high), max(-low, high)
        case "min" | "and":
            return min(low, other_low), min(high, other_high)
        case "max" | "or":
            return max(low, other_low), max(high, other_high)
        case "always" | "eventually" if node.interval.is_everything:
            return low, high
    return -np.inf, np.inf


def _quotient(a: Floats, b: Floats) -> Floats:
    """Divide; by zero it is an infinity of the dividend's sign, and 0 / 0 is zero."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.nan_to_num(a / b, nan=0.0, posinf=np.inf, neginf=-np.inf)


POINTWISE: dict[str, Callable[..., Floats]] = {
    "+": np.add,
    "-": np.subtract,
    "*": np.multiply,
    "/": _quotient,
    "min": np.minimum,
    "max": np.maximum,
    "negative": np.negative,
    "abs": np.abs,
    "room": np.subtract,
    "not": np.negative,
    "and": np.minimum,
    "or": np.maximum,
}
"""What an operation computes at each sample; `room` is the greater side of a comparison minus the smaller one."""


def _until(holds: Floats, takes: Floats, interval: Interval, time: Floats) -> Floats:
    """Return the value at the best moment for the right side to take over."""
    if interval.is_everything:
        result = takes.copy()
        for k in range(len(result) - 2, -1, -1):
            result[k] = max(takes[k], min(holds[k], result[k + 1]))
        return result
    result = np.full(len(time), -np.inf)
    first, after = interval.samples(time)
    for k in range(len(time)):
        if first[k] < after[k]:
            so_far = np.concatenate([[np.inf], np.minimum.accumulate(holds[k : after[k] - 1])])
            result[k] = np.minimum(takes[first[k] : after[k]], so_far[first[k] - k :]).max()
    return result


def _smallest(values: Floats, interval: Interval, time: Floats) -> Floats:
    """Return the smallest value within the interval from each sample on; +inf where it holds no sample."""
    if interval.is_everything:
        running: Floats = np.minimum.accumulate(values[::-1])[::-1]
        return running
    first, after = interval.samples(time)
    result = np.full(len(first), np.inf)
    width = after - first
    table, stretch = values, 1  # of minima over 1, 2, 4, ... samples
    while stretch <= len(values):
        here = (width >= stretch) & (width < 2 * stretch)
        if here.any():
            result[here] = np.minimum(table[first[here]], table[after[here] - stretch])
        if len(table) <= stretch:
            break
        table = np.minimum(table[:-stretch], table[stretch:])
        stretch *= 2
    return result


def signals_of(node: Node) -> frozenset[str]:
    """Return the names of the signals in a formula."""
    own = {node.name} if node.kind == "signal" else set()
    return frozenset(own).union(*(signals_of(part) for part in node.parts))


def body_of(node: Node) -> Node:
    """Return what a formula asks for at every moment: the part under an outermost `always` without bounds."""
    return node.parts[0] if node.kind == "always" and node.interval.is_everything else node


LONGEST = 2000


def joined_in(node: Node) -> tuple[Node, ...]:
    """Return the parts that `and` and `or` join in a formula; the formula itself where they join none."""
    return tuple(inner for part in node.parts for inner in joined_in(part)) if node.kind in ("and", "or") else (node,)


class FormulaError(InputError):
    """A formula that cannot be read: `position` counts characters from 1; the message points at the place."""

    def __init__(self, formula: str, position: int, message: str, *, code: str) -> None:
        self.formula = formula
        self.position = position
        self.reason = message
        super().__init__(f"{message} (at character {position})\n  {formula}\n  {' ' * (position - 1)}^", code=code)
