"""What to attempt next: ask and tell.

A strategy never simulates; it is told attempts and asked for briefs. Its state is a function of what it was told,
so a campaign resumes by telling it again from the ledger. All strategies spend the same number of runs: `scenarios`
times (1 + `refinements`) attempts.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from rvsg.campaign.attempt import Attempt
from rvsg.campaign.plan import Plan
from rvsg.campaign.ranking import remember, worst_by_mean
from rvsg.campaign.seeds import seed_for
from rvsg.scenario.brief import Brief, Feedback, Remembered

FeedbackOf = Callable[[Attempt, Attempt | None], Feedback]
"""What an attempt measured, against the attempt before it (None: the first of its scenario)."""


class Strategy(Protocol):
    """Anything that chooses briefs. Made as `Strategy(plan, feedback_of)`."""

    @property
    def name(self) -> str:
        """The name it is chosen by."""
        ...

    def ask(self) -> tuple[Brief, ...]:
        """The briefs that can be attempted now, independently of one another; none when the plan is done.

        They continue where the attempts told so far end: brief k becomes attempt `told + k`.
        """
        ...

    def tell(self, attempt: Attempt) -> None:
        """Learn of an attempt of the search; attempts are told in the order of their index."""
        ...


class StudyStrategy:
    """The study's method: refine a scenario from what it measured, then ask for one that differs from all before.

    A refinement reads the feedback on the last valid configuration of the scenario; as long as a scenario has none,
    it is asked for anew.
    """

    name = "study"

    def __init__(self, plan: Plan, feedback_of: FeedbackOf) -> None:
        self.plan = plan
        self.feedback_of = feedback_of
        self.told: list[Attempt] = []

    def ask(self) -> tuple[Brief, ...]:
        """One brief: what to try next depends on what the one before measured."""
        index = len(self.told)
        if index >= self.plan.attempts:
            return ()
        scenario_index = index // self.plan.configurations
        measured = [a for a in self.told if a.brief.scenario_index == scenario_index and a.mean is not None]
        if not measured:
            memory = remember(self.told, self.plan.requirement, last=self.plan.memory)
            return (self._brief(index, memory=memory),)
        at = self._refines(measured)
        feedback = self.feedback_of(measured[at], measured[at - 1] if at > 0 else None)
        return (self._brief(index, feedback=feedback),)

    def tell(self, attempt: Attempt) -> None:
        """Learn of an attempt."""
        self.told.append(attempt)

    def _brief(self, index: int, *, feedback: Feedback | None = None, memory: tuple[Remembered, ...] = ()) -> Brief:
        scenario_index, configuration_index = divmod(index, self.plan.configurations)
        return Brief(
            mission=self.plan.mission,
            requirement=self.plan.requirement,
            kind="refine" if feedback else "new",
            humans=self.plan.humans,
            seed=seed_for(self.plan.seed, "brief", index),
            scenario_index=scenario_index,
            configuration_index=configuration_index,
            feedback=feedback,
            memory=memory,
        )

    def _refines(self, measured: list[Attempt]) -> int:
        """The position of the attempt that is refined: the last."""
        return len(measured) - 1


class ClimbStrategy(StudyStrategy):
    """As the study's, but a refinement starts from the best configuration of the scenario so far, not from the last."""

    name = "climb"

    def _refines(self, measured: list[Attempt]) -> int:
        best = worst_by_mean(measured, self.plan.requirement)
        assert best is not None
        return measured.index(best)


class UnguidedStrategy:
    """The study's baseline: every attempt a new scenario, its generator told of no requirement, feedback or memory."""

    name = "unguided"

    def __init__(self, plan: Plan, feedback_of: FeedbackOf | None = None) -> None:
        self.plan = plan
        self.told = 0

    def ask(self) -> tuple[Brief, ...]:
        """All that is left: no attempt depends on another."""
        return tuple(
            Brief(
                mission=self.plan.mission,
                requirement=None,
                humans=self.plan.humans,
                seed=seed_for(self.plan.seed, "brief", index),
                scenario_index=index,
            )
            for index in range(self.told, self.plan.attempts)
        )

    def tell(self, attempt: Attempt) -> None:
        """Count an attempt."""
        self.told += 1


class RandomStrategy(UnguidedStrategy):
    """Random search: as unguided; the door chooses the random generator where none is named."""

    name = "random"
