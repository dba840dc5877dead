"""Words for requirements on the page and in the terminal."""

from __future__ import annotations

import math
import re

from rvsg.evaluation.metrics.registry import find_metric
from rvsg.evaluation.story import Sentence
from rvsg.scenario.requirement import Requirement


def quantity(requirement: Requirement) -> str:
    """Return the judged quantity in words, with the id of its metric."""
    if requirement.formula is not None:
        return "robustness of the formula"
    known = find_metric(requirement.metric)
    if known is None:
        return requirement.metric or "objective"
    title = known.title[:1].lower() + known.title[1:] if known.title[1:2].islower() else known.title
    return f"{title} ({requirement.metric})"


def direction(requirement: Requirement) -> str:
    """Return which values are worse, e.g. `lower is worse`."""
    return "lower is worse" if requirement.worse == "smaller" else "higher is worse"


def metres(gap: float) -> str:
    """Return a gap in words: whole centimetres below 1 m, never rounded down to a contact."""
    if gap <= 0.0:
        return "0 cm"
    return f"{max(1, round(gap * 100))} cm" if gap < 1.0 else f"{gap:.1f} m"


UNITS = "s|m|cm|m/s|m/s²|m/s³|rad|rad/s|Hz|%|USD|kB|MB|points"
_VALUE = re.compile(rf"(?<=\d) (?=(?:{UNITS})(?![\w/]))")


def unbroken(text: str) -> str:
    """Return a text in which no line breaks between a number and its unit."""
    return _VALUE.sub("\N{NO-BREAK SPACE}", text)


def shown_at(t_s: float) -> str:
    """Return the tenth of a second at which the replay shows what happens at a time: the first that is not before."""
    return f"{math.ceil(10 * t_s - 1e-6) / 10:.1f}"


def untimed(sentence: Sentence) -> str:
    """Return the text of a sentence without its time, which stands beside it."""
    text = sentence.text.removeprefix(f"At {sentence.time_s:.1f} s ").removeprefix(f"From {sentence.time_s:.1f} s on ")
    return text[:1].upper() + text[1:]
