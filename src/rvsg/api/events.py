"""Events of a running campaign, and the records they hold."""

from __future__ import annotations

from rvsg.campaign.attempt import Attempt
from rvsg.campaign.events import (
    Attempted,
    Confirming,
    Event,
    Explaining,
    Message,
    ModelCall,
    Proposing,
    RunMade,
    Shrinks,
)
from rvsg.campaign.plan import Plan
from rvsg.campaign.ranking import best_attempt, confirmations, rule, search_attempts

__all__ = [
    "Attempt",
    "Attempted",
    "Confirming",
    "Event",
    "Explaining",
    "Message",
    "ModelCall",
    "Plan",
    "Proposing",
    "RunMade",
    "Shrinks",
    "best_attempt",
    "confirmations",
    "rule",
    "search_attempts",
]
