"""The grammar of temporal formulas, and the mistakes in a text that is not one."""

from __future__ import annotations

import difflib
import functools
import re
from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np
from lark import Lark, Token
from lark.exceptions import UnexpectedCharacters, UnexpectedInput, VisitError
from lark.visitors import Transformer_NonRecursive, v_args

from rvsg.evaluation.temporal import LONGEST, FormulaError, Interval, Node

DEEPEST, MOST_NODES_DEEP = 40, 200
WHOLE = Interval()
KEYWORDS = ("always", "eventually", "until", "and", "or", "not", "implies")
FUNCTIONS = {"abs": 1, "min": 2, "max": 2}

# Numbers and formulas share one grammar, since both may stand in parentheses; _Builder tells them apart.
GRAMMAR = r"""
    ?start: disjunction | disjunction IMPLIES start -> implies
    ?disjunction: conjunction | disjunction OR conjunction -> infix
    ?conjunction: timed | conjunction AND timed -> infix
    ?timed: prefixed | timed UNTIL interval? prefixed -> infix
    ?prefixed: comparison | NOT prefixed -> prefixed | (ALWAYS | EVENTUALLY) interval? prefixed -> prefixed
    ?comparison: sum | sum COMPARE sum -> compared
    ?sum: product | sum (PLUS | MINUS) product -> arithmetic
    ?product: operand | product TIMES operand -> arithmetic
    ?operand: NUMBER -> number | NAME -> signal | MINUS operand -> negative | LPAR start ")" -> group
        | FUNCTION "(" sum ("," sum)* ")" -> function
    interval: LSQB bound "," bound "]"
    bound: NUMBER "s"? -> seconds | INF -> seconds

    IMPLIES: /implies\b|->/
    OR: /or\b|\|\|?/
    AND: /and\b|&&?/
    UNTIL: /until\b/
    NOT: /not\b|!(?!=)/
    ALWAYS: /always\b/
    EVENTUALLY: /eventually\b/
    COMPARE: "<=" | ">=" | "<" | ">"
    EQUALS: "==" | "!=" | "="
    PLUS: "+"
    MINUS: "-"
    TIMES: "*" | "/"
    LPAR: "("
    LSQB: "["
    INF.2: /inf\b/
    FUNCTION.2: /(abs|min|max)(?=\s*\()/
    NUMBER: /(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?/
    NAME: /(?!(always|eventually|until|and|or|not|implies)\b)[A-Za-z_]\w*/
    %ignore " "
"""


class Part(NamedTuple):
    """A parsed part of a formula."""

    node: Node
    formula: bool
    """Whether it is a formula; else it is a number."""
    at: int
    """The index of its first character."""
    measured: bool = False
    """Whether it depends on a signal."""
    depth: int = 1
    """How deeply its nodes are nested."""


class Mistake(Exception):
    """A mistake at an index of the formula."""

    def __init__(self, at: int, code: str, message: str) -> None:
        super().__init__(message)
        self.at = at
        self.code = code


def parse(text: str, signals: Collection[str]) -> Node:
    """Return a formula as a tree whose value is its robustness.

    Args:
        text: The formula.
        signals: The names that exist.

    Raises:
        FormulaError: it cannot be read.
    """
    if len(text) > LONGEST:
        long = f"the formula has {len(text)} characters; at most {LONGEST} are read"
        raise FormulaError(text[:60], 1, long, code="formula-long")
    text = " ".join(text.split())
    try:
        return read(text, signals)
    except Mistake as mistake:
        raise FormulaError(text, mistake.at + 1, str(mistake), code=mistake.code) from None


def read(text: str, signals: Collection[str]) -> Node:
    """Return the tree of a formula whose words are separated by single spaces.

    Raises:
        Mistake: it cannot be read.
    """
    depth = 0
    for at, sign in enumerate(text):
        depth += (sign == "(") - (sign == ")")
        if depth > DEEPEST + 1:
            raise Mistake(at, "formula-deep", f"nested deeper than {DEEPEST}")
    try:
        part: Part = _Builder(signals).transform(_parser().parse(text))
    except UnexpectedInput as error:
        raise _mistake_of(error, text, signals) from None
    except VisitError as error:
        raise error.orig_exc from None
    if not part.formula:
        raise Mistake(part.at, "formula-is-number", "the formula is a number: compare it with something")
    return part.node


@functools.cache
def _parser() -> Lark:
    return Lark(GRAMMAR, parser="lalr")


def _mistake_of(error: UnexpectedInput, text: str, signals: Collection[str]) -> Mistake:
    """Return what is wrong where the grammar fails."""
    token = getattr(error, "token", None)
    ended = token is not None and token.type == "$END"
    at = len(text) if ended else int(error.pos_in_stream or 0)
    for word in re.finditer(r"[A-Za-z_]\w*", text[:at]):  # a misspelt name explains most of what follows it
        if word.group() not in (*signals, *KEYWORDS, *FUNCTIONS, "inf", "s"):
            return _unknown(word.group(), word.start(), signals)
    if text.startswith(("=", "!="), at):
        return Mistake(at, "formula-equality", "signals are never exactly equal; compare with <, <=, > or >=")
    if isinstance(error, UnexpectedCharacters) or token is None:
        return Mistake(at, "formula-character", f'"{text[at]}" has no meaning here')
    symbol = "the end of the formula" if ended else f'"{token}"'
    expected: set[str] = set(getattr(error, "expected", ()))
    if "NAME" in expected:
        should = "a signal, a number or a formula"
        return Mistake(
            at,
            "formula-ends" if ended else "formula-expected",
            f"the formula ends where {should} should follow" if ended else f"expected {should}, found {symbol}",
        )
    if "INF" in expected:
        return Mistake(at, "formula-interval", f"expected seconds from now (a number >= 0, or inf), found {symbol}")
    if token.type == "COMPARE" and "AND" in expected:
        return Mistake(at, "formula-comparisons", 'one comparison at a time: join two with "and"')
    opened: list[int] = []
    for i, sign in enumerate(text[:at]):
        if sign in "([":
            opened.append(i)
        elif sign in ")]":
            opened.pop()
    if not opened:
        return Mistake(at, "formula-rest", f"the formula is complete before {symbol}")
    if text[opened[-1]] == "[":
        return Mistake(at, "formula-interval", f'an interval is "[low, high]": found {symbol}')
    return Mistake(at, "formula-open", f'expected ")" to close the "(" at character {opened[-1] + 1}, found {symbol}')


def _unknown(name: str, at: int, signals: Collection[str]) -> Mistake:
    near = difflib.get_close_matches(name, [*signals, *KEYWORDS], n=1, cutoff=0.5)
    asked = f' Did you mean "{near[0]}"?' if near else ""
    return Mistake(at, "formula-signal", f'there is no signal "{name}".{asked} Known: {", ".join(sorted(signals))}')


@v_args(inline=True)
class _Builder(Transformer_NonRecursive[Token, Part]):
    """Builds the nodes of a formula, and refuses what the grammar cannot."""

    def __init__(self, signals: Collection[str]) -> None:
        super().__init__()
        self.signals = signals

    def implies(self, left: Part, word: Token, right: Part) -> Part:
        _same(word, True, left, right)
        return _operation("or", word, True, left._replace(node=Node("not", (left.node,))), right)

    def infix(self, left: Part, word: Token, *rest: Part | Interval) -> Part:
        *bounds, right = rest
        return _of_formulas(word, bounds, left, right)

    def prefixed(self, word: Token, *rest: Part | Interval) -> Part:
        *bounds, part = rest
        return _of_formulas(word, bounds, part)

    def compared(self, left: Part, sign: Token, right: Part) -> Part:
        for part in (left, right):
            if part.formula:
                raise Mistake(part.at, "formula-operand", f'"{sign}" compares numbers, and this is a formula')
        if not (left.measured or right.measured):
            names = ", ".join(sorted(self.signals))
            same = "this compares numbers alone and is the same in every run"
            raise Mistake(left.at, "formula-constant", f"{same}; name a signal, one of {names}")
        greater, smaller = (left, right) if sign in (">", ">=") else (right, left)
        return _operation("room", sign, True, greater, smaller)

    def arithmetic(self, left: Part, sign: Token, right: Part) -> Part:
        _same(sign, False, left, right)
        if sign == "/" and not right.measured and not right.node.values(np.zeros(1), {})[0]:
            raise Mistake(right.at, "formula-division", "this divides by zero: the formula would never have a value")
        return _operation(str(sign), sign, False, left, right)

    def negative(self, sign: Token, part: Part) -> Part:
        _same(sign, False, part)
        return _operation("negative", sign, False, part)

    def group(self, sign: Token, part: Part) -> Part:
        return part._replace(at=_start(sign))

    def function(self, name: Token, *parts: Part) -> Part:
        if len(parts) != FUNCTIONS[name]:
            raise Mistake(_start(name), "formula-values", f"{name} takes {FUNCTIONS[name]} values, got {len(parts)}")
        _same(name, False, *parts)
        return _operation(str(name), name, False, *parts)

    def number(self, token: Token) -> Part:
        if float(token) == float("inf"):
            raise Mistake(_start(token), "formula-large", "this number is too large")
        return Part(Node("number", value=float(token)), False, _start(token))

    def signal(self, token: Token) -> Part:
        if token not in self.signals:
            raise _unknown(str(token), _start(token), self.signals)
        return Part(Node("signal", name=str(token)), False, _start(token), True)

    def seconds(self, token: Token) -> float:
        return float(token)

    def interval(self, opened: Token, low: float, high: float) -> Interval:
        if low > high:
            raise Mistake(
                _start(opened), "formula-interval", f"the interval ends ({high:g} s) before it begins ({low:g} s)"
            )
        if low == float("inf"):
            raise Mistake(_start(opened), "formula-interval", "the interval begins at infinity")
        return Interval(low, high)


def _start(token: Token) -> int:
    return int(token.start_pos or 0)


def _of_formulas(word: Token, bounds: Sequence[Part | Interval], *parts: Part | Interval) -> Part:
    """Return a logical operation, within bounds in seconds where they are given."""
    formulas = [part for part in parts if isinstance(part, Part)]
    _same(word, True, *formulas)
    interval = next((bound for bound in bounds if isinstance(bound, Interval)), WHOLE)
    return _operation(word.type.lower(), word, True, *formulas, interval=interval)


def _operation(kind: str, word: Token, formula: bool, *parts: Part, interval: Interval = WHOLE) -> Part:
    at = min(_start(word), *(part.at for part in parts))
    depth = 1 + max(part.depth for part in parts)
    if depth > MOST_NODES_DEEP:
        raise Mistake(at, "formula-deep", f"more than {MOST_NODES_DEEP} operations depend on each other")
    node = Node(kind, tuple(part.node for part in parts), interval)
    return Part(node, formula, at, any(part.measured for part in parts), depth)


def _same(word: Token, formula: bool, *parts: Part) -> None:
    """Refuse a number where a formula is needed, or the reverse."""
    for part in parts:
        if part.formula != formula:
            wrong = "joins formulas, and this is a number: compare it with something"
            wrong = wrong if formula else "works on numbers, and this is a formula"
            raise Mistake(part.at, "formula-operand", f'"{word}" {wrong}')
