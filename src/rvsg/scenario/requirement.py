"""A requirement as data: what is asked, which metric or temporal formula measures it, and from where on it fails."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from rvsg.core.records import Record


class Requirement(Record):
    """A requirement on the robot.

    `text` is what the VLM and the report read, `measured_as` how the objective is measured, in plain words; `note` is
    what people should know beside that, and no VLM reads it.
    Exactly one of `metric` (the id of a metric) and `formula` (signal temporal logic; its robustness is the
    objective, smaller is worse, violated below 0) is given.
    `limit`: the requirement is violated where the objective is beyond it in the `worse` direction;
    without a limit scenarios are ranked but no run fails. `limit_share` gives the limit as a share of the route's
    time limit instead; `for_time_limit` works it out.
    """

    name: Annotated[str, Field(min_length=1)]
    title: str
    text: str
    metric: str | None = None
    formula: str | None = None
    worse: Literal["smaller", "larger"] = "smaller"
    limit: float | None = None
    limit_share: Annotated[float, Field(gt=0)] | None = None
    unit: str = ""
    measured_as: str = ""
    note: str = ""
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
        """The requirement with the limit that holds on a route with this time limit."""
        if self.limit_share is None:
            return self
        return self.model_copy(update={"limit": self.limit_share * time_limit_s, "limit_share": None})

    @property
    def threshold(self) -> float | None:
        """The limit; 0 for a formula."""
        return 0.0 if self.formula is not None and self.limit is None else self.limit

    def violated_by(self, objective: float) -> bool:
        """Whether an objective value breaks the requirement; False where there is no limit."""
        limit = self.threshold
        if limit is None:
            return False
        return objective < limit if self.worse == "smaller" else objective > limit

    def worst(self, a: float, b: float) -> float:
        """The worse of two objective values."""
        return min(a, b) if self.worse == "smaller" else max(a, b)

    def badness(self, objective: float) -> float:
        """The objective with its sign turned so that larger is worse."""
        return -objective if self.worse == "smaller" else objective
