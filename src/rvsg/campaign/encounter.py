"""What kind of encounter a run shows, and the map of what breaks where."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from rvsg.campaign.attempt import Attempt
from rvsg.campaign.failures import FailureMode, mode_of
from rvsg.campaign.feedback import worst_run
from rvsg.campaign.glance import Look, glance_at
from rvsg.campaign.ranking import measured, standing
from rvsg.core.records import Record
from rvsg.scenario.brief import Encounter
from rvsg.scenario.requirement import Requirement
from rvsg.simulation.run import Run
from rvsg.world.world import World

STRETCHES = ("first third", "middle third", "last third")


def encounter_of(run: Run, world: World) -> Encounter | None:
    """Return the encounter at the closest approach of a run; None for a run without people."""
    return _encounter(run, mode_of(run, world))


def look_at(run: Run, world: World, *, told: bool = False) -> Look:
    """Return what a campaign asks of a run; `told`: what feedback takes of it as well."""
    mode = mode_of(run, world)
    return Look(run.id, mode, _encounter(run, mode), glance_at(run, world) if told else None)


def _encounter(run: Run, mode: FailureMode | None) -> Encounter | None:
    if mode is None:
        return None
    path = run.trajectory
    away = np.hypot(path.human_x - path.x[:, None], path.human_y - path.y[:, None])
    index, human = (int(k) for k in np.unravel_index(int((away - np.asarray(run.human_radius_m)).argmin()), away.shape))
    driven = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(path.x), np.diff(path.y)))])
    share = float(driven[index] / driven[-1]) if driven[-1] > 0.0 else 0.0
    return Encounter(
        stretch=STRETCHES[min(2, int(3.0 * share))], place=mode.place, who=run.human_names[human], kind=mode.person
    )


class MapCell(Record):
    """The worst configuration with one kind of encounter."""

    encounter: Encounter
    attempt: int
    """The attempt of the search."""
    scenario_id: str
    mean: float
    violations: int
    runs: int
    configurations: int
    """How many configurations show this encounter."""


def failure_map(
    attempts: Sequence[Attempt], requirement: Requirement, *, run_of: Callable[[str], Run], world: World
) -> tuple[MapCell, ...]:
    """Return the worst configuration of every kind of encounter among the attempts of a search, the worst first."""
    cells: dict[Encounter, list[Attempt]] = {}
    for attempt in measured(attempts):
        worst = worst_run(attempt, [run_of(m.run_id) for m in attempt.measurements], requirement)
        encounter = encounter_of(worst, world)
        if encounter is not None:
            cells.setdefault(encounter, []).append(attempt)
    ranked = [(max(found, key=lambda a: _rank(a, requirement)), encounter) for encounter, found in cells.items()]
    ranked.sort(key=lambda pair: _rank(pair[0], requirement), reverse=True)
    return tuple(_cell(attempt, encounter, len(cells[encounter])) for attempt, encounter in ranked)


def filled(cells: Iterable[MapCell]) -> tuple[int, int]:
    """Return how many cells there are, and how many of them hold a violation."""
    listed = list(cells)
    return len(listed), sum(cell.violations > 0 for cell in listed)


def _rank(attempt: Attempt, requirement: Requirement) -> tuple[float, float, int]:
    share, badness = standing(attempt, requirement)
    return (share, badness, -attempt.index)


def _cell(attempt: Attempt, encounter: Encounter, configurations: int) -> MapCell:
    scenario, verdict = attempt.proposal.scenario, attempt.verdict
    assert scenario is not None
    assert verdict is not None
    assert verdict.mean is not None
    return MapCell(
        encounter=encounter,
        attempt=attempt.index,
        scenario_id=scenario.id,
        mean=verdict.mean,
        violations=verdict.violations,
        runs=verdict.runs,
        configurations=configurations,
    )
