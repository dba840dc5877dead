"""Legitimate: whether a planned scenario may be run. Each rule answers for itself, and its reason is on record."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from rvsg.campaign.watch.parts import Change, Decision, Planned, RuleSet
from rvsg.scenario import validity
from rvsg.scenario.placement import start_gap_m
from rvsg.world.world import World


class DeclaredRules:
    """Refuses a plan that breaks a rule, and lets one wait where a person has to approve it.

    Args:
        approved: the ids of the plans that a person has approved, read again for every decision.
    """

    def __init__(self, rules: RuleSet, world: World, approved: Callable[[], frozenset[str]]) -> None:
        self.rules = rules
        self.world = world
        self.approved = approved

    def decide(self, planned: Planned, *, spent: int) -> Decision:
        """Decide on a plan by validity, plausibility, safety of the people, budget and approval, in this order."""
        broken = [*self._validity(planned), *self._plausibility(planned), *self._safety(planned)]
        broken += self._budget(planned, spent)
        if broken:
            return Decision(outcome="refused", reasons=tuple(broken))
        asks = self.rules.approval == "always" or (self.rules.approval == "new" and not planned.is_case)
        if not asks:
            return Decision(outcome="accepted", reasons=("all rules hold",))
        if planned.id in self.approved():
            return Decision(outcome="accepted", reasons=("all rules hold; a person approved it",))
        return Decision(outcome="waits", reasons=("approval: a person has to approve it",))

    def decide_change(self, change: Change, *, alike: int) -> Decision:
        """Decide on a change of the suite by the rules `write_back` and `max_failures`."""
        if self.rules.write_back == "never":
            return Decision(outcome="refused", reasons=("write_back: the suite is not changed",))
        if change.is_new and alike >= self.rules.max_failures:
            known = f"max_failures: the suite knows {alike} failures of {change.requirement} on this route"
            return Decision(outcome="refused", reasons=(known,))
        if self.rules.write_back == "always":
            return Decision(outcome="accepted", reasons=("write_back: always",))
        if change.id in self.approved():
            return Decision(outcome="accepted", reasons=("write_back: a person approved it",))
        return Decision(outcome="waits", reasons=("write_back: a person has to approve it",))

    def _validity(self, planned: Planned) -> Iterator[str]:
        for finding in validity.check(planned.scenario.people, planned.scenario.mission, self.world):
            yield f"validity: {finding}"

    def _plausibility(self, planned: Planned) -> Iterator[str]:
        low, high = self.rules.speed_m_s
        people = planned.scenario.people.humans
        if len(people) > self.rules.max_people:
            yield f"plausibility: {len(people)} people, at most {self.rules.max_people}"
        for human in people:
            if not low <= human.speed_m_s <= high:
                yield f"plausibility: {human.name} walks at {human.speed_m_s:g} m/s, not {low:g} to {high:g}"

    def _safety(self, planned: Planned) -> Iterator[str]:
        for human in planned.scenario.people.humans:
            if human.behaviour.value in self.rules.forbidden_behaviours:
                yield f"safety: {human.name} is asked to be {human.behaviour.value}"
            at = human.starts_at(self.world.grid)
            if at is None:
                continue
            gap = start_gap_m(human.radius_m, at, planned.scenario.mission)
            if gap < self.rules.start_gap_m:
                yield f"safety: {human.name} starts {gap:.2f} m from the robot, at least {self.rules.start_gap_m:g} m"

    def _budget(self, planned: Planned, spent: int) -> Iterator[str]:
        if planned.runs > self.rules.max_runs_per_plan:
            yield f"budget: {planned.runs} runs, at most {self.rules.max_runs_per_plan} for one plan"
        if spent + planned.runs > self.rules.max_runs:
            yield f"budget: {spent} of {self.rules.max_runs} runs are spent, and the plan may take {planned.runs}"
