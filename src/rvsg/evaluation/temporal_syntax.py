"""Parses temporal formulas; an error names the position.

    always (distance_to_person > 0.5 or speed < 0.1)
    always (distance_to_person < 0.8 implies eventually[0, 2] speed < 0.3)
    speed < 0.2 until distance_to_person > 1.0

From loosest to tightest: implies (to the right), or, and, until; then not, always, eventually, each of which takes
the next comparison or parenthesis alone; then < <= > >=; then + -, * /, -x. Functions: abs(x), min(x, y), max(x, y).
Intervals are in seconds: always[0, 5], eventually[1, inf]. A formula is data: nothing in it is executed.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Collection
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rvsg.core.errors import InputError
from rvsg.evaluation.temporal import (
    Always,
    Arithmetic,
    Comparison,
    Eventually,
    Interval,
    Joined,
    Node,
    Not,
    Number,
    Signal,
    Until,
)

LONGEST, DEEPEST = 2000, 40
KEYWORDS = ("always", "eventually", "until", "and", "or", "not", "implies")
FUNCTIONS = {"abs": 1, "min": 2, "max": 2}
_TOKEN = re.compile(
    r"\s*(?:(?P<number>\d+(?:\.\d*)?(?:[eE][+-]?\d+)?|\.\d+(?:[eE][+-]?\d+)?)|(?P<word>[A-Za-z_]\w*)"
    r"|(?P<sign>->|<=|>=|==|!=|&&|\|\||[-+*/<>()\[\],!&|=]))"
)
_ALIASES = {"&&": "and", "&": "and", "||": "or", "|": "or", "!": "not", "->": "implies"}


class FormulaError(InputError):
    """A formula that cannot be read: `position` counts characters from 1; the message points at the place."""

    def __init__(self, formula: str, position: int, message: str) -> None:
        self.formula = formula
        self.position = position
        self.reason = message
        super().__init__(f"{message} (at character {position})\n  {formula}\n  {' ' * (position - 1)}^")


class Token(NamedTuple):
    """A word, number or sign and where it begins (from 0)."""

    kind: str
    text: str
    at: int


class Part(NamedTuple):
    """A parsed part, whether it is a formula (else a number), where it begins, and whether it depends on a signal."""

    node: Node
    formula: bool
    at: int
    measured: bool = False


def parse(text: str, signals: Collection[str]) -> Node:
    """Return the formula as a tree whose value is its robustness. Raises FormulaError.

    `signals` are the names that exist.
    """
    if len(text) > LONGEST:
        raise FormulaError(text[:60], 1, f"the formula has {len(text)} characters; at most {LONGEST} are read")
    reader = _Reader(" ".join(text.split()), signals)
    part = reader.formula(0)
    reader.expect_end()
    if not part.formula:
        raise reader.error(part.at, "the formula is a number: compare it with something")
    return part.node


@dataclass
class _Reader:
    text: str
    signals: Collection[str]

    def __post_init__(self) -> None:
        self.tokens = self._tokens()
        self.next = 0

    def _tokens(self) -> list[Token]:
        found: list[Token] = []
        at = 0
        while at < len(self.text):
            match = _TOKEN.match(self.text, at)
            if match is None:
                start = at + len(self.text[at:]) - len(self.text[at:].lstrip())
                raise self.error(start, f'"{self.text[start]}" has no meaning here')
            kind = str(match.lastgroup)
            word = match.group(kind)
            start = match.start(kind)
            if word in ("==", "!=", "="):
                raise self.error(start, "signals are never exactly equal; compare with <, <=, > or >=")
            found.append(Token(kind, _ALIASES.get(word, word), start))
            at = match.end()
        return [*found, Token("end", "the end of the formula", len(self.text))]

    def error(self, at: int, message: str) -> FormulaError:
        return FormulaError(self.text, at + 1, message)

    @property
    def token(self) -> Token:
        return self.tokens[self.next]

    def take(self, *texts: str) -> Token | None:
        """Return the next token if it is one of these."""
        token = self.token
        if token.kind != "end" and token.text in texts:
            self.next += 1
            return token
        return None

    def expect(self, text: str, why: str) -> Token:
        token = self.take(text)
        if token is None:
            raise self.error(self.token.at, f'expected "{text}" {why}, found {self._shown(self.token)}')
        return token

    def expect_end(self) -> None:
        if self.token.kind != "end":
            raise self.error(self.token.at, f"the formula is complete before {self._shown(self.token)}")

    def _shown(self, token: Token) -> str:
        return token.text if token.kind == "end" else f'"{token.text}"'

    def formula(self, depth: int) -> Part:
        """Parse a formula, or inside parentheses perhaps a number; `implies` binds loosest."""
        if depth > DEEPEST:
            raise self.error(self.token.at, f"nested deeper than {DEEPEST}")
        left = self._or(depth)
        if token := self.take("implies"):
            right = self.formula(depth + 1)
            self._both(token, left, right)
            return Part(Joined("or", Not(left.node), right.node), True, left.at)
        return left

    def _or(self, depth: int) -> Part:
        left = self._and(depth)
        while token := self.take("or"):
            right = self._and(depth)
            self._both(token, left, right)
            left = Part(Joined("or", left.node, right.node), True, left.at)
        return left

    def _and(self, depth: int) -> Part:
        left = self._until(depth)
        while token := self.take("and"):
            right = self._until(depth)
            self._both(token, left, right)
            left = Part(Joined("and", left.node, right.node), True, left.at)
        return left

    def _until(self, depth: int) -> Part:
        left = self._unary(depth)
        while token := self.take("until"):
            interval = self._interval()
            right = self._unary(depth)
            self._both(token, left, right)
            left = Part(Until(left.node, right.node, interval), True, left.at)
        return left

    def _unary(self, depth: int) -> Part:
        if depth > DEEPEST:
            raise self.error(self.token.at, f"nested deeper than {DEEPEST}")
        token = self.take("not", "always", "eventually")
        if token is None:
            return self._comparison(depth)
        interval = self._interval() if token.text != "not" else Interval()
        part = self._unary(depth + 1)
        self._formula_after(token, part)
        node: Node
        if token.text == "not":
            node = Not(part.node)
        else:
            node = (Always if token.text == "always" else Eventually)(part.node, interval)
        return Part(node, True, token.at)

    def _comparison(self, depth: int) -> Part:
        left = self._sum(depth)
        token = self.take("<", "<=", ">", ">=")
        if token is None:
            return left
        right = self._sum(depth)
        for part in (left, right):
            if part.formula:
                raise self.error(part.at, f'"{token.text}" compares numbers, and this is a formula')
        if self.token.text in ("<", "<=", ">", ">="):
            raise self.error(self.token.at, 'one comparison at a time: join two with "and"')
        if not (left.measured or right.measured):
            known = ", ".join(sorted(self.signals))
            raise self.error(
                left.at, f"this compares numbers alone and is the same in every run; name a signal, one of {known}"
            )
        greater, smaller = (left, right) if token.text in (">", ">=") else (right, left)
        return Part(Comparison(greater.node, smaller.node), True, left.at, True)

    def _sum(self, depth: int) -> Part:
        left = self._product(depth)
        while token := self.take("+", "-"):
            left = self._arithmetic(token, left, self._product(depth))
        return left

    def _product(self, depth: int) -> Part:
        left = self._operand(depth)
        while token := self.take("*", "/"):
            left = self._arithmetic(token, left, self._operand(depth))
        return left

    def _arithmetic(self, token: Token, left: Part, right: Part) -> Part:
        self._numbers(token, left, right)
        if token.text == "/" and not right.measured and not right.node.values(np.zeros(1), {})[0]:
            raise self.error(right.at, "this divides by zero: the formula would never have a value")
        node = Arithmetic(token.text, left.node, right.node)  # type: ignore[arg-type]
        return Part(node, False, left.at, left.measured or right.measured)

    def _operand(self, depth: int) -> Part:
        if depth > DEEPEST:
            raise self.error(self.token.at, f"nested deeper than {DEEPEST}")
        token = self.token
        if token.kind == "end":
            raise self.error(token.at, "the formula ends where a signal, a number or a formula should follow")
        self.next += 1
        if token.kind == "number":
            if float(token.text) == float("inf"):
                raise self.error(token.at, "this number is too large")
            return Part(Number(float(token.text)), False, token.at)
        if token.text == "-":
            part = self._operand(depth + 1)
            self._numbers(token, part)
            return Part(Arithmetic("negative", part.node), False, token.at, part.measured)
        if token.text == "(":
            part = self.formula(depth + 1)
            self.expect(")", f'to close the "(" at character {token.at + 1}')
            return Part(part.node, part.formula, token.at, part.measured)
        if token.text in FUNCTIONS and self.token.text == "(":
            return self._function(token, depth)
        if token.kind == "word" and token.text not in KEYWORDS:
            return self._signal(token)
        raise self.error(token.at, f"expected a signal, a number or a formula, found {self._shown(token)}")

    def _function(self, token: Token, depth: int) -> Part:
        self.expect("(", "after the function")
        parts = [self._sum(depth + 1)]
        while self.take(","):
            parts.append(self._sum(depth + 1))
        self.expect(")", f"to close {token.text}(")
        if len(parts) != FUNCTIONS[token.text]:
            raise self.error(token.at, f"{token.text} takes {FUNCTIONS[token.text]} values, got {len(parts)}")
        self._numbers(token, *parts)
        second = parts[1].node if len(parts) > 1 else None
        node = Arithmetic(token.text, parts[0].node, second)  # type: ignore[arg-type]
        return Part(node, False, token.at, any(part.measured for part in parts))

    def _signal(self, token: Token) -> Part:
        if token.text not in self.signals:
            near = difflib.get_close_matches(token.text, [*self.signals, *KEYWORDS], n=1, cutoff=0.5)
            asked = f' Did you mean "{near[0]}"?' if near else ""
            known = ", ".join(sorted(self.signals))
            raise self.error(token.at, f'there is no signal "{token.text}".{asked} Known: {known}')
        return Part(Signal(token.text), False, token.at, True)

    def _interval(self) -> Interval:
        """Parse [low, high] in seconds, if it is next."""
        opened = self.take("[")
        if opened is None:
            return Interval()
        low = self._bound()
        self.expect(",", "between the bounds of the interval")
        high = self._bound()
        self.expect("]", "to close the interval")
        if low > high:
            raise self.error(opened.at, f"the interval ends ({high:g} s) before it begins ({low:g} s)")
        if low == float("inf"):
            raise self.error(opened.at, "the interval begins at infinity")
        return Interval(low, high)

    def _bound(self) -> float:
        token = self.token
        self.next += token.kind != "end"
        if token.kind == "number":
            self.take("s")
            return float(token.text)
        if token.text == "inf":
            return float("inf")
        raise self.error(token.at, f"expected seconds from now (a number >= 0, or inf), found {self._shown(token)}")

    def _both(self, token: Token, *parts: Part) -> None:
        for part in parts:
            self._formula_after(token, part)

    def _formula_after(self, token: Token, part: Part) -> None:
        if not part.formula:
            raise self.error(part.at, f'"{token.text}" joins formulas, and this is a number: compare it with something')

    def _numbers(self, token: Token, *parts: Part) -> None:
        for part in parts:
            if part.formula:
                raise self.error(part.at, f'"{token.text}" works on numbers, and this is a formula')
