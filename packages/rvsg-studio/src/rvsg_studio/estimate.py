"""Time and cost of a campaign, before it begins."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence

from rvsg.app.matrix import Matrix
from rvsg.app.proposal import propose
from rvsg.app.settings import LISTED, CampaignConfig, effective
from rvsg.app.wiring import Wired, jobs_of, wire
from rvsg.core.errors import InputError
from rvsg.core.plugins import ignore
from rvsg.core.records import Record, canonical_json
from rvsg_studio.listing import FoundCampaign

TRIAL_RUNS = 2


class Estimate(Record):
    """What a campaign will take, at most. None if nothing is known to estimate it from."""

    runs: int
    """Runs of search and confirmation."""
    proposals: int
    minutes: float
    usd: float | None
    run_s: float
    """What one run took here, seconds; the mean of a few."""
    jobs: int
    calls_of: str = ""
    """The model whose calls are part of it."""
    known_calls: int = 0
    """Calls of that model in earlier campaigns, from which time and price of a call are taken."""


def estimate(
    config: CampaignConfig,
    earlier: Iterable[FoundCampaign] = (),
) -> Estimate:
    """Estimate a campaign by simulating its mission a few times, and by what calls of its model took earlier.

    Raises:
        InputError: a setting cannot be used.
    """
    wired = wire(config)
    plan, jobs = wired.plan, jobs_of(config)
    run_s = _run_s(wired)
    runs_s = plan.runs * run_s / jobs
    if config.generator_name != "vlm" or config.replay is not None:
        return Estimate(runs=plan.runs, proposals=plan.attempts, minutes=runs_s / 60, usd=0.0, run_s=run_s, jobs=jobs)
    model = config.model or ""
    alike = [each for each in earlier if each.calls and each.model == model]
    calls, priced = sum(each.calls for each in alike), [each for each in alike if each.cost_usd is not None]
    call_s = sum(each.calls_s for each in alike) / calls if calls else 0.0
    paid = sum(each.calls for each in priced)
    each_usd = sum(each.cost_usd or 0.0 for each in priced) / paid if paid else None
    return Estimate(
        runs=plan.runs,
        proposals=plan.attempts,
        minutes=(runs_s + plan.attempts * call_s / plan.max_in_flight) / 60,
        usd=None if each_usd is None else each_usd * plan.attempts,
        run_s=run_s,
        jobs=jobs,
        calls_of=model,
        known_calls=calls,
    )


def estimate_all(matrix: Matrix, earlier: Sequence[FoundCampaign] = ()) -> Estimate:
    """Estimate the campaigns of a matrix together; they share the workers of one machine.

    Raises:
        InputError: a setting cannot be used.
    """
    found = [
        estimate(effective(None, {}, matrix.settings | dict(zip(LISTED, pair, strict=True))), earlier)
        for pair in matrix.pairs
    ]
    costs = [each.usd for each in found]
    return found[0].model_copy(
        update={
            "runs": sum(each.runs for each in found),
            "proposals": sum(each.proposals for each in found),
            "minutes": sum(each.minutes for each in found),
            "run_s": sum(each.run_s * each.runs for each in found) / max(1, sum(each.runs for each in found)),
            "usd": None if None in costs else sum(cost for cost in costs if cost is not None),
        }
    )


_known: dict[str, float] = {}


def _run_s(wired: Wired) -> float:
    """Return the seconds that a run of a scenario of this size takes here."""
    plan, simulator = wired.plan, wired.simulator
    key = canonical_json([plan.mission.id, simulator.name, dict(simulator.options), plan.humans])
    if key not in _known:
        simulator.prepare(ignore)
        proposal = propose(wired.world, plan.mission.route, plan.requirement, humans=plan.humans, seed=0)
        scenario = proposal.scenario
        if scenario is None:
            raise InputError(f"No scenario with {plan.humans} people is found to estimate from; take fewer people.")
        scenario = scenario.replace(mission=plan.mission)
        begun = time.perf_counter()
        for seed in range(TRIAL_RUNS):
            simulator.run(scenario, wired.world, seed=seed)
        _known[key] = (time.perf_counter() - begun) / TRIAL_RUNS
    return _known[key]
