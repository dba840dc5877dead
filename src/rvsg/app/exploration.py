"""Exploration of a scenario: violations over its ranges, and its smallest form."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rvsg.campaign.exploration import FEWEST, Exploration, Point, shares_of
from rvsg.campaign.runner import Measuring, PendingRun, Runner
from rvsg.campaign.smallest_scenario import Shrinking, Shrunk, Simplification
from rvsg.core.errors import InputError
from rvsg.core.files import write_whole
from rvsg.core.outputs import check_writable, write_text
from rvsg.core.plugins import Spec, ignore
from rvsg.core.seeds import seed_for
from rvsg.evaluation.statistics import Sensitivity, Surface, clopper_pearson, fit_surface, sensitivities
from rvsg.evaluation.verdict import load_requirement
from rvsg.report.comparison_page import response_page, response_svg
from rvsg.scenario import validity
from rvsg.scenario.builder import check_valid, load_family, scenario_json
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Scenario
from rvsg.scenario.variation import Range, ScenarioFamily
from rvsg.scenario.world_lookup import world_of
from rvsg.simulation.simulators import Simulator, simulator_of
from rvsg.world.world import World

FORMATS = (".html", ".svg", ".json")


def explore(
    family: ScenarioFamily | str | Path,
    requirement: Requirement | str = "R1",
    *,
    vary: Sequence[str] = (),
    runs: int = 60,
    seed: int = 0,
    jobs: int = 1,
    simulator: str | Spec | Simulator = "embedded",
    world: World | str | Path | None = None,
    on_point: Callable[[Point], None] = ignore,
    on_message: Callable[[str], None] = ignore,
) -> Exploration:
    """Run a scenario at points of its ranges and fit how often it violates a requirement.

    The points are a Latin hypercube. Each is run once, with a seed of its own: for a surface, more points say more
    than repeated ones.

    Args:
        runs: points of the Latin hypercube.
        seed: of the points and of the runs.
        simulator: a name, a Spec, or an instance, which stays open.

    Raises:
        InputError: no range, a requirement without a limit, or no point that is valid.
    """
    if not isinstance(family, ScenarioFamily):
        family, found = load_family(family, vary)
        world = world or found
    place = world_of(family.middle.mission, world)
    asked = load_requirement(requirement, family.middle.mission.route)
    if asked.threshold is None:
        raise InputError(f"{asked.name} has no limit, so no run violates it. Choose a requirement with a limit.")
    measuring = Measuring(asked, place)
    with (
        simulator_of(simulator, scenario=family.middle, on_message=on_message) as made,
        Runner(made, place, measuring=measuring, jobs=jobs, notify=on_message) as runner,
    ):
        submitted = [
            _submit(runner, family, values, seed_for(seed, "run", k))
            for k, values in enumerate(_hypercube(family.ranges, runs, seed))
        ]
        points = [_collect(each, asked, on_point) for each in submitted]
    return _explored(family, asked, points, seed=seed, simulator=made.name)


def check_exploration_format(path: Path) -> None:
    """Refuse a file whose ending is none that an exploration can be written as."""
    if path.suffix.lower() not in FORMATS:
        raise InputError(f"{path}: an exploration is written as {', '.join(FORMATS)}. Give --out one of these endings.")


def check_outputs(out: Path | None, worst: Path | None) -> None:
    """Check before the work that its files can be written: the exploration, and the scenario of the worst point."""
    if out is not None:
        check_exploration_format(out)
    for file in (out, worst):
        if file is not None:
            check_writable(file)


def write_outputs(found: Exploration, out: Path | None, worst: Path | None) -> None:
    """Write an exploration, and the scenario of its worst point, where each is asked for."""
    if out is not None:
        write_exploration(out, found)
    if worst is not None:
        write_text(worst, worst_point(found))


def write_exploration(path: str | Path, found: Exploration) -> None:
    """Write an exploration as a page (.html), as its picture (.svg) or as the numbers (.json)."""
    path = Path(path)
    check_exploration_format(path)
    kind = path.suffix.lower()
    if kind == ".json":
        write_whole(path, found.to_json())
    elif kind == ".html":
        write_whole(path, response_page(found))
    else:
        write_whole(path, response_svg(found, alone=True))


def worst_point(found: Exploration) -> str:
    """Return the scenario at the point with the worst objective as JSON."""
    judged = [point for point in found.points if point.objective is not None]
    worst = max(judged, key=lambda point: found.requirement.badness(point.objective or 0.0))
    family = ScenarioFamily(middle=found.scenario, ranges=found.ranges)
    return scenario_json(family.at(worst.values))


def _hypercube(ranges: Sequence[Range], count: int, seed: int) -> list[tuple[float, ...]]:
    from scipy.stats import qmc

    sampler = qmc.LatinHypercube(len(ranges), rng=np.random.default_rng(seed_for(seed, "explore")))
    shares = sampler.random(count)
    return [tuple(round(r.at(float(s)), 6) for r, s in zip(ranges, row, strict=True)) for row in shares]


@dataclass(frozen=True)
class _Submitted:
    """A point of the ranges whose run was submitted, or that is no valid scenario."""

    values: tuple[float, ...]
    seed: int
    problems: tuple[str, ...]
    pending: PendingRun | None


def _submit(runner: Runner, family: ScenarioFamily, values: tuple[float, ...], seed: int) -> _Submitted:
    scenario = family.at(values)
    problems = tuple(str(each) for each in validity.check(scenario.people, scenario.mission, runner.world))
    return _Submitted(values, seed, problems, None if problems else runner.submit(scenario, seed))


def _collect(submitted: _Submitted, requirement: Requirement, on_point: Callable[[Point], None]) -> Point:
    """Return a point with what its run measured."""
    point = Point(values=submitted.values, seed=submitted.seed, problems=submitted.problems)
    if submitted.pending is not None:
        run = submitted.pending.finished()
        value = run.measurement.objective
        violated = None if value is None else requirement.violated_by(value)
        point = point.replace(objective=value, violated=violated, outcome=run.outcome.value)
    on_point(point)
    return point


def _explored(
    family: ScenarioFamily, requirement: Requirement, points: Sequence[Point], *, seed: int, simulator: str
) -> Exploration:
    """Return what the points say: how often they violate, the surface and which range matters."""
    judged = [point for point in points if point.violated is not None]
    if not judged:
        raise InputError(f"No point of the ranges can be judged: {'; '.join(points[0].problems) or 'no value'}.")
    violations = sum(bool(point.violated) for point in judged)
    surface: Surface | None = None
    sensitive: tuple[Sensitivity, ...] = ()
    if len(judged) >= FEWEST:
        shares = shares_of(family.ranges, judged)
        surface = fit_surface(shares, [bool(point.violated) for point in judged])
        badness = [None if p.objective is None else requirement.badness(p.objective) for p in judged]
        sensitive = sensitivities(surface, [each.name for each in family.ranges], shares, badness, seed=seed)
    return Exploration(
        scenario=family.middle,
        ranges=family.ranges,
        requirement=requirement,
        simulator=simulator,
        seed=seed,
        points=tuple(points),
        violations=violations,
        runs=len(judged),
        interval=clopper_pearson(violations, len(judged)),
        surface=surface,
        sensitivities=sensitive,
    )


def describe_exploration(found: Exploration) -> str:
    """Return what was found as lines for a terminal."""
    low, high = found.interval
    lines = [
        f"{found.requirement.name} is violated in {found.violations} of {found.runs} runs over the ranges "
        f"({100 * low:.0f} to {100 * high:.0f} %)."
    ]
    if invalid := sum(bool(point.problems) for point in found.points):
        lines.append(f"{invalid} of {len(found.points)} points are no valid scenario and were not run.")
    if found.surface is None:
        return "\n".join([*lines, f"A surface needs at least {FEWEST} runs."])
    if found.surface.degree == 0:
        lines.append("The runs show no dependence on the ranges.")
    for each in sorted(found.sensitivities, key=lambda s: -s.share):
        told = f"  {each.name}: {100 * each.at_low:.0f} % at the low end, {100 * each.at_high:.0f} % at the high end"
        if each.p is not None and each.correlation is not None:
            told += f"; rank correlation with the objective {each.correlation:+.2f} (p {each.p:.2g})"
        lines.append(told)
    return "\n".join(lines)


def shrink(
    scenario: Scenario,
    requirement: str | Path | Requirement = "R1",
    *,
    repeats: int = 12,
    confirmations: int = 20,
    keep: float = 0.8,
    seed: int = 0,
    jobs: int = 1,
    simulator: str | Spec | Simulator = "embedded",
    world: World | str | Path | None = None,
    on_step: Callable[[Simplification], None] = ignore,
    on_message: Callable[[str], None] = ignore,
) -> Shrunk:
    """Find the smallest scenario that violates a requirement about as often.

    People, tasks, pauses and delays are removed one by one as long as the violations stay.

    Args:
        repeats: runs of every simpler scenario.
        confirmations: runs with new seeds of the original and of the smallest.
        keep: the share of the original's violations that has to stay.
        simulator: a name, a Spec, or an instance, which stays open.

    Raises:
        InvalidScenario: the scenario breaks a rule.
        InputError: the requirement has no limit, or the scenario does not violate it.
    """
    place = world_of(scenario.mission, world)
    check_valid(scenario, place)
    asked = load_requirement(requirement, scenario.mission.route)
    measuring = Measuring(asked, place)
    with (
        simulator_of(simulator, scenario=scenario, on_message=on_message) as made,
        Runner(made, place, measuring=measuring, jobs=jobs, notify=on_message) as runner,
    ):
        return Shrinking(
            requirement=asked,
            runner=runner,
            judge=measuring.judge,
            seed=seed,
            repeats=repeats,
            confirmations=confirmations,
            keep=keep,
            watch=on_step,
        )(scenario)
