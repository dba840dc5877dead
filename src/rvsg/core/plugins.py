"""Finds plug-ins by name: the only place that reads entry points. Built-ins register as third-party ones do.

A plug-in is loaded only when it is asked for; a name that does not exist is answered with "did you mean".
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from importlib.metadata import EntryPoint, entry_points
from inspect import signature
from typing import Any

from rvsg.core.errors import InputError, UnknownName

KINDS = {
    "generator": "rvsg.generators",
    "simulator": "rvsg.simulators",
    "strategy": "rvsg.strategies",
    "executor": "rvsg.executors",
    "store": "rvsg.stores",
}


def names(kind: str) -> tuple[str, ...]:
    """The names of all plug-ins of a kind, e.g. `generator`."""
    return tuple(sorted(_found(kind)))


def find(kind: str, name: str) -> Any:
    """The class registered under this name; UnknownName, or InputError where its module cannot be loaded."""
    found = _found(kind)
    if name not in found:
        raise UnknownName(kind, name, found)
    try:
        return found[name].load()
    except (ImportError, AttributeError) as error:
        raise InputError(
            f'The {kind} "{name}" ({found[name].value}) cannot be loaded: {error}. Is what it needs installed?'
        ) from error


def make(kind: str, name: str, options: Mapping[str, Any], *given: Any) -> Any:
    """An instance of a plug-in with these options, after what is `given` to every plug-in of the kind."""
    plugin = able(kind, name, options, given=len(given))
    try:
        return plugin(*given, **options)
    except (TypeError, ValueError) as error:
        raise InputError(f'The {kind} "{name}" cannot be made with {dict(options) or "no options"}: {error}') from error


def able(kind: str, name: str, options: Mapping[str, Any], *, given: int = 0) -> Any:
    """The class of a plug-in that takes these options; `given` is how many values every plug-in of the kind is given.

    InputError says which option it does not take, which one may be meant, and which there are.
    """
    plugin = find(kind, name)
    if unknown := _not_taken(plugin, options, given):
        known = _taken(plugin)[given:]
        near = difflib.get_close_matches(unknown[0], known, n=1, cutoff=0.5)
        asked = f' Did you mean "{near[0]}"?' if near else ""
        listed = f"Known options: {', '.join(known)}." if known else "It takes none."
        raise InputError(f'The {kind} "{name}" has no option "{unknown[0]}".{asked} {listed}')
    return plugin


def _taken(plugin: Any) -> tuple[str, ...]:
    """The options a plug-in takes by name."""
    return tuple(
        p.name for p in signature(plugin).parameters.values() if p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY)
    )


def _not_taken(plugin: Any, options: Mapping[str, Any], given: int) -> list[str]:
    """The options that a plug-in does not take; none where it takes any."""
    if any(p.kind is p.VAR_KEYWORD for p in signature(plugin).parameters.values()):
        return []
    return sorted(options.keys() - set(_taken(plugin)[given:]))


def _found(kind: str) -> dict[str, EntryPoint]:
    return {point.name: point for point in entry_points(group=KINDS[kind])}
