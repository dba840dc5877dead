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
from rvsg.core.seeds import seed_for
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
    it is asked for anew. With `plan.abreast` k > 1 the scenarios are worked on in groups of k, in turn: every
    refinement still reads the configuration before it, but a scenario is not told of the others of its group.
    """

    name = "study"

    def __init__(self, plan: Plan, feedback_of: FeedbackOf) -> None:
        self.plan = plan
        self.feedback_of = feedback_of
        self.told: list[Attempt] = []
        self._briefs: list[Brief] = []

    def ask(self) -> tuple[Brief, ...]:
        """What can be tried now. What is tried as number n follows from the attempts before n + 1 - k, k of the plan.

        So up to k attempts are under way at a time, and which they are does not depend on who is done first.
        """
        told = len(self.told)
        while (index := len(self._briefs)) < self.plan.attempts and (known := self._known(index)) <= told:
            self._briefs.append(self._next(index, self.told[:known]))
        return tuple(self._briefs[told:])

    def tell(self, attempt: Attempt) -> None:
        """Learn of an attempt."""
        if len(self.told) == len(self._briefs):
            self._briefs.append(attempt.brief)
        self.told.append(attempt)

    def _known(self, index: int) -> int:
        """How many attempts have to be known before attempt `index` is chosen; no more are looked at."""
        return max(0, index + 1 - self._place(index)[2])

    def _next(self, index: int, known: list[Attempt]) -> Brief:
        """The brief of attempt `index`, from the attempts known."""
        scenario, configuration, _ = self._place(index)
        measured = [a for a in known if a.brief.scenario_index == scenario and a.mean is not None]
        if not measured:
            memory = remember(known, self.plan.requirement, last=self.plan.memory)
            return self._brief(index, (scenario, configuration), memory=memory)
        at = self._refines(measured)
        feedback = self.feedback_of(measured[at], measured[at - 1] if at > 0 else None)
        return self._brief(index, (scenario, configuration), feedback=feedback)

    def _place(self, index: int) -> tuple[int, int, int]:
        """Scenario and configuration of attempt `index`, and how many scenarios are worked on beside each other."""
        group, rest = divmod(index, self.plan.abreast * self.plan.configurations)
        first = group * self.plan.abreast
        width = min(self.plan.abreast, self.plan.scenarios - first)
        configuration, lane = divmod(rest, width)
        return first + lane, configuration, width

    def _brief(
        self,
        index: int,
        place: tuple[int, int],
        *,
        feedback: Feedback | None = None,
        memory: tuple[Remembered, ...] = (),
    ) -> Brief:
        return Brief(
            mission=self.plan.mission,
            requirement=self.plan.requirement,
            kind="refine" if feedback else "new",
            humans=self.plan.humans,
            seed=seed_for(self.plan.seed, "brief", index),
            scenario_index=place[0],
            configuration_index=place[1],
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
