"""The elite strategy: many first drafts, then refinements for those that did worst by the robot."""

from __future__ import annotations

import numpy as np

from rvsg.campaign.attempt import Attempt
from rvsg.campaign.ranking import remember, worst_by_mean
from rvsg.campaign.seeds import seed_for
from rvsg.campaign.strategies import StudyStrategy
from rvsg.scenario.brief import Brief

KEEN = 0.5
"""The best scenario is refined with this probability, the next with half of what is left, and so on."""


class EliteStrategy(StudyStrategy):
    """As many scenarios as the study's, each drafted once; then every refinement goes to one of the best.

    The study's method spends as much on its weakest scenario as on its best. Here a scenario is refined the more
    often the worse it does by the robot. A scenario's standing is the mean of its two best configurations, so that
    one lucky measurement does not draw all refinements (its refinements, measured independently, bear it out or do
    not); what is refined is its best configuration. Equal cost: scenarios x (1 + refinements) attempts.
    """

    name = "elite"

    def ask(self) -> tuple[Brief, ...]:
        """One brief: a draft as long as there are scenarios to begin, then a refinement of one of the best."""
        index = len(self.told)
        if index >= self.plan.attempts:
            return ()
        standing = self._standing()
        if index < self.plan.scenarios or not standing:
            memory = remember(self.told, self.plan.requirement, last=self.plan.memory)
            begun = 1 + max((a.brief.scenario_index for a in self.told), default=-1)
            return (self._brief(index, memory=memory).replace(scenario_index=begun, configuration_index=0),)
        chosen = standing[self._rank(index, len(standing))]
        best = worst_by_mean(chosen, self.plan.requirement)
        assert best is not None
        at = chosen.index(best)
        feedback = self.feedback_of(best, chosen[at - 1] if at > 0 else None)
        tried = sum(a.brief.scenario_index == best.brief.scenario_index for a in self.told)
        brief = self._brief(index, feedback=feedback)
        place = {"scenario_index": best.brief.scenario_index, "configuration_index": tried}
        return (brief.replace(**place),)

    def _standing(self) -> list[list[Attempt]]:
        """The measured attempts of every scenario, the scenario that did worst by the robot first."""
        groups: dict[int, list[Attempt]] = {}
        for attempt in self.told:
            if attempt.mean is not None:
                groups.setdefault(attempt.brief.scenario_index, []).append(attempt)

        def standing(group: list[Attempt]) -> float:
            badness = sorted((self.plan.requirement.badness(a.mean) for a in group if a.mean is not None), reverse=True)
            return sum(badness[:2]) / len(badness[:2])

        return sorted(groups.values(), key=lambda group: (-standing(group), group[0].index))

    def _rank(self, index: int, count: int) -> int:
        """Which of the ranked scenarios is refined: of a geometric distribution, from the campaign's seed."""
        rng = np.random.default_rng(seed_for(self.plan.seed, "elite", index))
        return int(min(rng.geometric(KEEN), count)) - 1
