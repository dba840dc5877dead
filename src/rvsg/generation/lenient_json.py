"""Finds JSON in what a model wrote: among prose, in fences, half broken or cut off.

Reading is lenient and says what it mended; judging what was read is the business of others. Time is linear in the
length of the text, and nesting is bounded, whatever the text holds.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, field
from typing import Any

from rvsg.core.inputs import whole_text

MAX_DEPTH = 40
MAX_STARTS = 2000
WORK_PER_CHARACTER = 24
LONGEST_NUMBER = 300
_SURROGATE = re.compile(r"\\u[dD][89a-fA-F]|[\ud800-\udfff]")
_BARE = re.compile(r"[A-Za-z_][\w\-]*")
_NUMBER = re.compile(r"-?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
_SPACE = re.compile(r"(?:\s|//[^\n]*|/\*.*?\*/|#[^\n]*)+", re.DOTALL)
_QUOTES = {'"': '"', "'": "'", "“": "”", "‘": "’", "`": "`", "«": "»"}
_ESCAPES = {"n": "\n", "t": "\t", "r": "\r", "b": "\b", "f": "\f"}
_WORDS = {"true": True, "True": True, "false": False, "False": False, "null": None, "None": None, "undefined": None}


@dataclass(frozen=True, kw_only=True)
class Found:
    """A JSON value found in a text, between `start` and `end`; `mended` says in words what was not proper JSON."""

    value: Any
    start: int
    end: int
    mended: tuple[str, ...] = ()


class _NotJson(Exception):
    pass


@dataclass
class _Reader:
    """A recursive reader of what was meant to be JSON."""

    text: str
    at: int
    work: int
    mended: dict[str, None] = field(default_factory=dict)
    ended_early: bool = False

    def mend(self, what: str) -> None:
        self.mended[what] = None

    def spend(self, amount: int) -> None:
        self.work -= amount
        if self.work < 0:
            raise _NotJson("too much work")

    def skip(self) -> None:
        found = _SPACE.match(self.text, self.at)
        if found:
            if not found.group().isspace():
                self.mend("a comment was left out")
            self.spend(found.end() - self.at)
            self.at = found.end()

    def peek(self) -> str:
        self.skip()
        return self.text[self.at] if self.at < len(self.text) else ""

    def value(self, depth: int) -> Any:
        if depth > MAX_DEPTH:
            raise _NotJson("nested too deeply")
        self.spend(1)
        sign = self.peek()
        if sign == "{":
            return self.object(depth)
        if sign == "[":
            return self.array(depth)
        if sign in _QUOTES and sign:
            return self.string()
        number = _NUMBER.match(self.text, self.at)
        if number and (sign.isdigit() or sign in "-."):
            following = self.text[number.end() : number.end() + 1]
            if not (following.isalpha() or following == "_"):
                self.at = number.end()
                return _number(number.group())
        word = _BARE.match(self.text, self.at)
        if word:
            return self.word(word.group())
        if not sign:
            self.ended_early = True
            self.mend("the text ended before the JSON did")
            return None
        raise _NotJson(f"unexpected {sign!r}")

    def word(self, word: str) -> Any:
        """A bare word: true, false, null, or an unquoted string up to the next mark."""
        if word in _WORDS:
            self.at += len(word)
            if word not in ("true", "false", "null"):
                self.mend(f"{word} was read as JSON's own word")
            return _WORDS[word]
        end = self.at
        while end < len(self.text) and self.text[end] not in ',]}\n"':
            end += 1
        text = self.text[self.at : end].strip()
        if ":" in text or end - self.at > 200:
            raise _NotJson("prose")
        self.spend(end - self.at)
        self.at = end
        self.mend("a text without quotation marks")
        return text

    def string(self) -> str:
        opening = self.text[self.at]
        closing = _QUOTES[opening]
        if opening != '"':
            self.mend(f"a text in {opening}{closing} instead of double quotation marks")
        out: list[str] = []
        at = self.at + 1
        text = self.text
        while at < len(text):
            sign = text[at]
            if sign == "\\" and at + 1 < len(text):
                at += self.escape(at, out)
                continue
            if sign == closing and self.really_closes(at, closing):
                self.spend(at - self.at)
                self.at = at + 1
                return "".join(out)
            if sign == "\n":
                self.mend("a line break inside a text")
            out.append(sign)
            at += 1
        self.spend(at - self.at)
        self.at = at
        self.ended_early = True
        self.mend("the text ended before the JSON did")
        return "".join(out)

    def escape(self, at: int, out: list[str]) -> int:
        """Read one escape at `at` into `out`; how many characters it takes."""
        sign = self.text[at + 1]
        if sign == "u":
            digits = self.text[at + 2 : at + 6]
            if len(digits) == 4 and all(d in "0123456789abcdefABCDEF" for d in digits):
                code = int(digits, 16)
                out.append(chr(code) if not 0xD800 <= code < 0xE000 else "�")
                return 6
        out.append(_ESCAPES.get(sign, sign))
        return 2

    def really_closes(self, at: int, closing: str) -> bool:
        """Whether a quotation mark ends the text: what follows must go on with the JSON, else it is part of it."""
        following = self.text[at + 1 : at + 40].lstrip()
        if not following or following[0] in ",]}:" or following.startswith(("//", "/*", "#", "```")):
            return True
        # A missing comma: the next item begins on its own line or right away with a mark of its own.
        if following[0] in '"{[' or (closing == "'" and following[0] == "'"):
            return True
        self.mend("a quotation mark inside a text")
        return False

    def object(self, depth: int) -> dict[str, Any]:
        self.at += 1
        found: dict[str, Any] = {}
        while self.item_follows("}"):
            key = self.key(self.peek())
            if self.peek() not in (":", "="):
                if not self.peek():
                    self.cut_off()
                    return found
                raise _NotJson("a key without a value")
            self.at += 1
            value = self.value(depth + 1)
            if self.ended_early and value is None:
                return found
            if key in found:
                self.mend(f'the key "{key}" twice')
            found[key] = value
            if not self.separator("}"):
                break
        return found

    def item_follows(self, closing: str) -> bool:
        """Whether another item of an object or array begins here; passes stray commas and the closing mark."""
        while (sign := self.peek()) == ",":
            self.at += 1
            self.mend("a comma too many")
        if sign == closing:
            self.at += 1
        elif not sign:
            self.cut_off()
        else:
            return True
        return False

    def key(self, sign: str) -> str:
        if sign in _QUOTES:
            return self.string()
        bare = _BARE.match(self.text, self.at)
        if bare is None:
            raise _NotJson(f"unexpected {sign!r} for a key")
        self.at = bare.end()
        self.mend("a key without quotation marks")
        return bare.group()

    def array(self, depth: int) -> list[Any]:
        self.at += 1
        found: list[Any] = []
        while self.item_follows("]"):
            if self.text.startswith(("...", "…"), self.at):
                self.at += 3 if self.text[self.at] == "." else 1
                self.mend("an ellipsis was left out")
                continue
            value = self.value(depth + 1)
            if self.ended_early and value is None:
                return found
            found.append(value)
            if not self.separator("]"):
                break
        return found

    def separator(self, closing: str) -> bool:
        """Step over what stands between two items; False where the container ends without its bracket."""
        if self.ended_early:
            return False
        sign = self.peek()
        if sign == ",":
            self.at += 1
            if self.peek() == closing:
                self.mend("a comma too many")
            return True
        if sign == closing:
            return True
        if not sign:
            self.cut_off()
            return False
        if sign in "]}":
            # The other bracket: this container was not closed. The one around it may be.
            self.mend("a bracket that was not closed")
            return False
        if sign in ';"{[' or sign in _QUOTES:
            self.at += sign == ";"
            self.mend("a missing comma")
            return True
        if self.text.startswith("```", self.at):
            self.cut_off()
            return False
        raise _NotJson(f"unexpected {sign!r} between items")

    def cut_off(self) -> None:
        self.ended_early = True
        self.mend("the text ended before the JSON did")


def _number(text: str) -> int | float | str:
    if len(text) > LONGEST_NUMBER:
        return text  # no number of anything; whoever expects one refuses the text
    try:
        return int(text)
    except ValueError:
        value = float(text)
        return value if value not in (float("inf"), float("-inf")) else text


def find_json(text: str) -> tuple[Found, ...]:
    """Every JSON object or list in a text, in order, outermost only.

    Proper JSON is read as such; anything else that begins with a brace or bracket is read leniently where it is
    mostly JSON. Lists are found only where they hold objects, or stand in a fence or alone: prose is full of
    `[G7, G8]`.
    """
    found: list[Found] = []
    decoder = json.JSONDecoder(parse_constant=_refused, parse_float=_finite, parse_int=_short)
    work = WORK_PER_CHARACTER * len(text) + 10_000
    at = 0
    for _ in range(MAX_STARTS):
        starts = [i for i in (text.find("{", at), text.find("[", at)) if i >= 0]
        if not starts or work <= 0:
            break
        start = min(starts)
        one = _strict(decoder, text, start)
        if one is None:
            one, work = _lenient(text, start, work)
        if one is None or not _worth_it(one, text):
            at = start + 1
            continue
        found.append(one)
        at = max(one.end, start + 1)
    return tuple(found)


def _refused(name: str) -> Any:
    raise ValueError(f"{name} is not JSON")


def _short(text: str) -> int:
    if len(text) > LONGEST_NUMBER:
        raise ValueError("a number with too many digits")
    return int(text)


def _finite(text: str) -> float:
    value = float(text)
    if value in (float("inf"), float("-inf")):
        raise ValueError(f"{text} is too large")
    return value


def _strict(decoder: json.JSONDecoder, text: str, start: int) -> Found | None:
    try:
        value, end = decoder.raw_decode(text, start)
    except (ValueError, RecursionError):
        return None
    if _SURROGATE.search(text, start, end):
        value = _whole(value)
    return Found(value=value, start=start, end=end)


def _whole(value: Any) -> Any:
    """The value with every half of a character replaced; it could not be stored."""
    if isinstance(value, str):
        return whole_text(value)
    if isinstance(value, dict):
        return {whole_text(key): _whole(item) for key, item in value.items()}
    return [_whole(item) for item in value] if isinstance(value, list) else value


def _lenient(text: str, start: int, work: int) -> tuple[Found | None, int]:
    reader = _Reader(text=text, at=start, work=work)
    try:
        value = reader.value(0)
    except _NotJson:
        # What was spent in vain counts too, or a text of nothing but brackets would take for ever.
        return None, reader.work - 16
    return Found(value=value, start=start, end=reader.at, mended=tuple(reader.mended)), reader.work


def _worth_it(found: Found, text: str) -> bool:
    """Whether what was found is data, not a bracket in prose."""
    if isinstance(found.value, dict):
        return bool(found.value) or not found.mended
    if any(isinstance(item, dict) for item in found.value):
        return True
    before = text[: found.start].rstrip()
    alone = not before and not text[found.end :].strip()
    fenced = before.endswith(("```", "```json", "```JSON"))
    return bool(found.value) and (alone or fenced)
