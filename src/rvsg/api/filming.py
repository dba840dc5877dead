"""Find the run that `rvsg replay` shows: in a campaign, in a file of runs, or by simulating a scenario."""

from __future__ import annotations

from pathlib import Path

from rvsg.api.campaign import Campaign
from rvsg.api.records import holds_runs, read_runs
from rvsg.api.scenarios import load_scenario_in
from rvsg.api.simulating import simulate
from rvsg.api.worlds import load_world
from rvsg.campaign.attempt import Attempt, Measurement
from rvsg.campaign.ranking import best_attempt
from rvsg.core.errors import InputError, UnknownName
from rvsg.core.plugins import Spec
from rvsg.evaluation.wording import number
from rvsg.report.facts import RunFacts, run_facts
from rvsg.report.film import Shot
from rvsg.report.film import check_film as check_film
from rvsg.report.film import write_film as write_film
from rvsg.report.happened import still_times
from rvsg.report.quantity import closest_approach
from rvsg.report.words import quantity
from rvsg.robots.robot import Robot
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Scenario
from rvsg.simulation.run import Run
from rvsg.world.world import World


def shot_of(
    source: Path,
    *,
    run: str | None = None,
    seed: int = 0,
    world: str | None = None,
    simulator: str | Spec = "embedded",
) -> Shot:
    """Return what to film.

    Args:
        source: The folder of a campaign, a file of runs, or a scenario.
        run: The id of a run of the campaign or the file; by default the worst run of the worst finding, or the first
            run of the file.
        seed: The seed with which a scenario is simulated.
        world: The world, where it was moved or the file of runs does not name it.

    Raises:
        InputError: the source holds no run, or its world is not known.
        UnknownName: there is no run of that id.
    """
    if source.is_dir() or source.suffix == ".sqlite":
        return _of_campaign(Campaign.open(source), run, world)
    if holds_runs(source):
        if world is None:
            raise InputError(f"{source}: a file of runs does not say in which world they took place. Add --world.")
        chosen = chosen_run(read_runs([source]), run)
        return _plain(chosen, load_world(world), None)
    scenario, place = load_scenario_in(source, world)
    made = simulate(scenario, [seed], simulator=simulator, world=place)
    return _plain(made[0], place, scenario.mission.robot_record)


def _of_campaign(campaign: Campaign, run: str | None, world: str | None) -> Shot:
    attempts = [attempt for attempt in campaign.attempts() if attempt.measurements]
    known = {m.run_id: (attempt, m) for attempt in attempts for m in attempt.measurements}
    if run is not None and run not in known:
        raise UnknownName("run", run, known)
    attempt, measured = known[run] if run is not None else worst_run(campaign, attempts)
    place = campaign.world if world is None else load_world(world)
    found = next(each for each in campaign.runs() if each.id == measured.run_id)
    scenario = attempt.proposal.scenario
    assert scenario is not None  # it has a run
    return shot_of_run(found, measured, campaign.requirement, place, scenario)


def shot_of_run(run: Run, measured: Measurement, requirement: Requirement, world: World, scenario: Scenario) -> Shot:
    """Return a shot of a run at the moments that matter for a requirement."""
    facts = run_facts(run, measured, requirement, world, scenario)
    return Shot(
        run=run,
        world=world,
        robot=scenario.mission.robot_record,
        moments=still_times(facts),
        judged=lambda t_s: _judged(facts, requirement, t_s),
    )


def worst_run(campaign: Campaign, attempts: list[Attempt]) -> tuple[Attempt, Measurement]:
    """Return the worst run of the worst finding of a campaign, and its attempt; InputError if there is none."""
    chosen = campaign.summary().confirmed or best_attempt(attempts, campaign.requirement)
    if chosen is None or not chosen.measurements:
        raise InputError(f"{campaign.folder}: this campaign holds no run yet.")
    requirement = campaign.requirement

    def badness(measurement: Measurement) -> float:
        value = measurement.objective
        return requirement.badness(value) if value is not None else float("-inf")

    return chosen, max(chosen.measurements, key=badness)


def chosen_run(runs: list[Run], run: str | None) -> Run:
    """Return the run of an id, or the first; UnknownName if there is none of that id."""
    known = {each.id: each for each in runs}
    if run is None:
        return runs[0]
    if run not in known:
        raise UnknownName("run", run, known)
    return known[run]


def _plain(run: Run, world: World, robot: Robot | None) -> Shot:
    end, closest = float(run.trajectory.t[-1]), closest_approach(run)
    times = sorted({round(t, 1) for t in (end / 4, closest, end)})
    return Shot(run=run, world=world, robot=robot, moments=times)


def _judged(facts: RunFacts, requirement: Requirement, t_s: float) -> str:
    """Return what the requirement measures up to a time, with its limit."""
    known = [float(v) for t, v in zip(facts.curve.t, facts.curve.value, strict=True) if t <= t_s and v == v]
    if not known:
        return ""
    limit = requirement.threshold
    beside = f" (limit {number(limit, requirement.unit)})" if limit is not None else ""
    return f"{quantity(requirement)} so far: {number(known[-1], requirement.unit)}{beside}"
