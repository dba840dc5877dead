"""A requirement as data: what is asked, what measures it, and its limit."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from rvsg.core.records import Record


class Requirement(Record):
    """A requirement on the robot.

    Exactly one of `metric` and `formula` is given. Without a limit scenarios are ranked, but no run fails.
    """

    name: Annotated[str, Field(min_length=1)]
    title: str
    text: str
    """What the generator and the report read."""
    metric: str | None = None
    """Id of the metric that is the objective."""
    formula: str | None = None
    """Signal temporal logic; its robustness is the objective, smaller is worse, violated below 0."""
    worse: Literal["smaller", "larger"] = "smaller"
    """The direction in which the objective gets worse."""
    limit: float | None = None
    """The requirement is violated where the objective is beyond it, in the `worse` direction."""
    limit_share: Annotated[float, Field(gt=0)] | None = None
    """The limit as a share of the route's time limit; `for_time_limit` works it out."""
    unit: str = ""
    measured_as: str = ""
    """How the objective is measured, in plain words."""
    note: str = ""
    """What people should know about it; no model reads it."""
    source: str = ""

    @model_validator(mode="after")
    def _one_measure(self) -> Self:
        if (self.metric is None) == (self.formula is None):
            raise ValueError("give exactly one of metric and formula")
        if self.formula is not None and self.worse != "smaller":
            raise ValueError("a formula's robustness is worse when smaller")
        if self.limit is not None and self.limit_share is not None:
            raise ValueError("give limit or limit_share, not both")
        return self

    def for_time_limit(self, time_limit_s: float) -> Requirement:
        """Return the requirement with the limit that holds on a route with this time limit."""
        if self.limit_share is None:
            return self
        return self.model_copy(update={"limit": self.limit_share * time_limit_s, "limit_share": None})

    @property
    def threshold(self) -> float | None:
        """The limit; 0 for a formula."""
        return 0.0 if self.formula is not None and self.limit is None else self.limit

    def violated_by(self, objective: float) -> bool:
        """Return whether an objective violates the requirement; False without a limit."""
        limit = self.threshold
        if limit is None:
            return False
        return objective < limit if self.worse == "smaller" else objective > limit

    def worst(self, a: float, b: float) -> float:
        """Return the worse of two objectives."""
        return min(a, b) if self.worse == "smaller" else max(a, b)

    def badness(self, objective: float) -> float:
        """Return the objective with its sign turned so that larger is worse."""
        return -objective if self.worse == "smaller" else objective
