"""What each address of data answers, as functions of the workspace and the question."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import rvsg
from rvsg.api.errors import InputError
from rvsg.api.showing import related, replay_of_attempts
from rvsg.studio.workspace import Workspace

Answer = Callable[[Workspace, dict[str, Any]], Any]


def text_of(given: dict[str, Any], key: str) -> str:
    """Return a text of a question; InputError where it is missing."""
    value = given.get(key)
    if not isinstance(value, str) or not value:
        raise InputError(f"The question lacks {key!r}.")
    return value


def number_of(given: dict[str, Any], key: str) -> int:
    """Return a whole number of a question; InputError where it is missing or none."""
    try:
        return int(str(given[key]))
    except (KeyError, ValueError):
        raise InputError(f"The question lacks a whole number {key!r}.") from None


def replay(workspace: Workspace, given: dict[str, Any]) -> dict[str, Any]:
    """Return the replay of an attempt of a campaign, and of what is tied to it unless it is asked for `alone`."""
    folder = workspace.existing(text_of(given, "campaign"))
    alone = bool(given.get("alone"))
    name, index = given.get("name") or None, number_of(given, "attempt")

    def made() -> dict[str, Any]:
        campaign = rvsg.Campaign.open(folder, name)
        shown = related(campaign.attempts(), index)
        return replay_of_attempts(campaign, shown[:1] if alone else shown)

    found: dict[str, Any] = workspace.kept(("replay", str(folder), name, index, alone), folder, made)
    return found


ANSWERS: dict[str, Answer] = {"replay": replay}
"""Questions by their address below `/data/`: they change nothing."""
CHANGES: dict[str, Answer] = {}
"""What may change something or takes a long question."""
