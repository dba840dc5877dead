"""Turns the text of options into values."""

from __future__ import annotations

import contextlib
from typing import Any

from rvsg import Spec
from rvsg.core.errors import InputError
from rvsg.core.inputs import is_too_deep
from rvsg.simulation.stacks.registry import DEFAULT_STACK


def pairs(kind: str, given: list[str] | None) -> dict[str, Any]:
    """Return the `NAME=VALUE` options of a plug-in, the values read as YAML."""
    return dict(_pair(kind, pair) for pair in given or [])


def spec(kind: str, name: str, options: list[str] | None) -> Spec:
    """Return a plug-in by its name and its `NAME=VALUE` options."""
    return Spec(name, pairs(kind, options))


def states(given: list[str] | None) -> dict[str, Any]:
    """Return `NAME=STATE` of doors; the states are checked where the world is known."""
    found = {}
    for pair in given or []:
        name, equals, state = pair.rpartition("=")
        if not equals or not name:
            raise InputError(
                f"--door {pair[:60]!r}: expected NAME=open, NAME=closed or NAME=automatic", code="door-form"
            )
        found[name] = state
    return found


def stack_spec(name: str | None, options: list[str] | None) -> Spec | None:
    """Return the navigation stack under test with its `NAME=VALUE` options; None for the simulator's own."""
    if name is None and not options:
        return None
    return Spec(name or DEFAULT_STACK, pairs("stack", options))


def _pair(kind: str, pair: str) -> tuple[str, Any]:
    import yaml

    name, equals, value = pair.partition("=")
    if not equals or not name:
        raise InputError(f"--{kind}-option {pair!r}: expected NAME=VALUE", code="option-form")
    try:
        read = yaml.safe_load(value)
    except (yaml.YAMLError, ValueError) as error:
        raise InputError(f"--{kind}-option {name[:60]}: the value cannot be read: {error}") from None
    except RecursionError:
        raise InputError(f"--{kind}-option {name[:60]}: the value is nested too deep") from None
    if is_too_deep(read):
        raise InputError(f"--{kind}-option {name[:60]}: the value is nested too deep")
    if isinstance(read, str):
        with contextlib.suppress(ValueError):
            return name, float(read)  # YAML reads 1e2 and nan as text
    return name, read


def seconds_of(option: str, text: str) -> float:
    """Return a time such as 90s, 15m or 1h in seconds."""
    import re

    match = re.fullmatch(r"(\d+(?:\.\d+)?)\s*([smh]?)", text.strip())
    if match is None:
        raise InputError(f"{option} {text!r}: expected a time such as 90s, 15m or 1h.")
    return float(match[1]) * {"": 1.0, "s": 1.0, "m": 60.0, "h": 3600.0}[match[2]]
