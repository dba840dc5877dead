"""Parser of temporal formulas. An error names the position.

    always (distance_to_person > 0.5 or speed < 0.1)
    always (distance_to_person < 0.8 implies eventually[0, 2] speed < 0.3)
    speed < 0.2 until distance_to_person > 1.0

From loosest to tightest: implies (to the right), or, and, until; then not, always, eventually, each of which takes
the next comparison or parenthesis alone; then < <= > >=; then + -, * /, -x. Functions: abs(x), min(x, y), max(x, y).
Intervals are in seconds: always[0, 5], eventually[1, inf]. A formula is data: nothing in it is executed.
"""

from __future__ import annotations

from collections.abc import Collection

from rvsg.core.errors import InputError
from rvsg.evaluation.temporal import Node

LONGEST = 2000


class FormulaError(InputError):
    """A formula that cannot be read: `position` counts characters from 1; the message points at the place."""

    def __init__(self, formula: str, position: int, message: str, *, code: str) -> None:
        self.formula = formula
        self.position = position
        self.reason = message
        super().__init__(f"{message} (at character {position})\n  {formula}\n  {' ' * (position - 1)}^", code=code)


def parse(text: str, signals: Collection[str]) -> Node:
    """Return a formula as a tree whose value is its robustness.

    Args:
        text: The formula.
        signals: The names that exist.

    Raises:
        FormulaError: it cannot be read.
    """
    from rvsg.evaluation.temporal_grammar import Mistake, read  # loads lark, which most commands do not need

    if len(text) > LONGEST:
        long = f"the formula has {len(text)} characters; at most {LONGEST} are read"
        raise FormulaError(text[:60], 1, long, code="formula-long")
    text = " ".join(text.split())
    try:
        return read(text, signals)
    except Mistake as mistake:
        raise FormulaError(text, mistake.at + 1, str(mistake), code=mistake.code) from None
