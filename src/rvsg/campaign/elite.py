"""The elite strategy: many first drafts, then refinements for those that did worst by the robot."""

from __future__ import annotations

import numpy as np

from rvsg.campaign.attempt import Attempt
from rvsg.campaign.ranking import worst_by_mean
from rvsg.campaign.strategies import StudyStrategy
from rvsg.core.seeds import seed_for
from rvsg.scenario.brief import Brief

KEEN = 0.5
"""The best scenario is refined with this probability, the next with half of what is left, and so on."""


class EliteStrategy(StudyStrategy):
    """As many scenarios as the study's, each drafted once; then every refinement goes to one of the best.

    The study's method spends as much on its weakest scenario as on its best. Here a scenario is refined the more
    often the worse it does by the robot. A scenario's standing is the mean of its two best configurations, so that
    one lucky measurement does not draw all refinements (its refinements, measured independently, bear it out or do
    not); what is refined is its best configuration. Equal cost: scenarios x (1 + refinements) attempts, of which
    `plan.max_in_flight` are under way at a time: so many refinements are chosen before the first of them is measured.
    """

    name = "elite"

    def _known(self, index: int) -> int:
        """Return all drafts have to be known before the first refinement, and else all but those under way."""
        drafts = self.plan.scenarios
        return max(0, drafts if index >= drafts else 0, index + 1 - self.plan.max_in_flight)

    def _next(self, index: int, known: list[Attempt]) -> Brief:
        """Return a draft as long as there are scenarios to begin, then a refinement of one of the best."""
        standing = self._standing(known)
        if index < self.plan.scenarios or not standing:
            begun = 1 + max(self._scenarios, default=-1)
            return self._new(index, (begun, 0), known)
        chosen = standing[self._rank(index, len(standing))]
        best = worst_by_mean(chosen, self.plan.requirement)
        assert best is not None
        at, scenario = chosen.index(best), best.scenario_index
        tried = self._scenarios.count(scenario)
        feedback = self.feedback_of(best, chosen[at - 1] if at > 0 else None)
        if self.plan.proposals is not None and chosen[-1] is not best:
            feedback = feedback.replace(weaker=self.feedback_of(chosen[-1], None))
        return self._refinement(index, (scenario, tried), feedback, known)

    def _standing(self, known: list[Attempt]) -> list[list[Attempt]]:
        """Return the measured attempts of every scenario, the scenario that did worst by the robot first."""
        groups: dict[int, list[Attempt]] = {}
        for attempt in known:
            if attempt.mean is not None:
                groups.setdefault(attempt.scenario_index, []).append(attempt)

        def standing(group: list[Attempt]) -> float:
            badness = sorted((self.plan.requirement.badness(a.mean) for a in group if a.mean is not None), reverse=True)
            return sum(badness[:2]) / len(badness[:2])

        return sorted(groups.values(), key=lambda group: (-standing(group), group[0].index))

    def _rank(self, index: int, count: int) -> int:
        """Return which of the ranked scenarios is refined: of a geometric distribution, from the campaign's seed."""
        rng = np.random.default_rng(seed_for(self.plan.seed, "elite", index))
        return int(min(rng.geometric(KEEN), count)) - 1
