"""What the replay component reads back is the run, to the centimetre."""

from __future__ import annotations

import base64
import zlib
from functools import cache
from itertools import accumulate

import numpy as np
import pytest
from tests.campaign.parts import REQUIREMENT, MemoryLedger, warehouse
from tests.evaluation.runs import run_of, trajectory
from tests.report.test_page import campaign, default_campaign, default_page, page

from rvsg.campaign.runner import Evaluator
from rvsg.evaluation.metrics.registry import METRICS
from rvsg.evaluation.sampled import Sampled
from rvsg.evaluation.verdict import objective
from rvsg.report.replay_data import (
    FAR_STEP,
    INVOLVED_M,
    ReplayGroup,
    distinct_colours,
    people_colours,
    replay_payload,
    varints,
)
from rvsg.report.run_facts import decisive, judged_curve, prefix, run_facts
from rvsg.scenario.requirement import Requirement
from rvsg.simulation.run import Outcome, Run


@cache
def a_run() -> Run:
    ledger = MemoryLedger()
    _, attempts = campaign(ledger)
    return ledger.run(attempts[0].measurements[0].run_id)


def unpacked(data: bytes) -> list[int]:
    """The integers of concatenated channels, as differences."""
    found, value, shift = [], 0, 0
    for byte in data:
        value |= (byte & 0x7F) << shift
        shift += 7
        if byte < 0x80:
            found.append((value >> 1) ^ -(value & 1))
            value = shift = 0
    return found


def payload(run: Run) -> dict[str, object]:
    facts = run_facts(run, Evaluator(REQUIREMENT, warehouse()).measure(run), REQUIREMENT, warehouse())
    return replay_payload(
        [ReplayGroup(id="0", label="runs", purpose="search", runs=(facts,))],
        mission=campaign(MemoryLedger())[0].mission,
        requirement=REQUIREMENT,
        world=warehouse(),
        matrix="matrix(1 0 0 1 0 0)",
    )


@pytest.mark.parametrize("values", [[0], [5, -5, 300, -70000, 2**40], list(range(-200, 200))])
def test_varints_are_read_back(values: list[int]) -> None:
    assert list(accumulate(unpacked(varints(np.array(values, dtype=np.int64))))) == values


def test_a_run_is_kept_at_10_hz_to_the_centimetre() -> None:
    run = a_run()
    data = payload(run)["groups"][0]["runs"][0]
    steps = unpacked(zlib.decompress(base64.b64decode(data["blob"])))
    n = data["samples"]
    assert n == round(float(run.trajectory.t[-1]) / 0.1) + 1
    x = np.array(list(accumulate(steps[:n]))) / 100
    rows = np.clip(np.searchsorted(run.trajectory.t, np.arange(n) * 0.1 - 1e-9), 0, len(run.trajectory) - 1)
    assert np.abs(x - run.trajectory.x[rows]).max() <= 0.005 + 1e-9
    far = [-(-n // FAR_STEP) if h in data["far"] else n for h in range(len(run.human_names))]
    assert len(steps) == 5 * n + 3 * sum(far)


def test_the_judged_quantity_ends_at_the_objective() -> None:
    run, world = a_run(), warehouse()
    formula = Requirement(name="F", title="", text="", formula="always (distance_to_person > 0.5)")
    for requirement in (REQUIREMENT, formula, REQUIREMENT.replace(metric="trg", worse="larger", limit=30.0, unit="s")):
        curve = judged_curve(run, requirement, world)
        assert curve.value[-1] == objective(run, requirement, world=world)


def test_a_mean_is_decided_where_the_run_adds_most_to_it() -> None:
    run, world = a_run(), warehouse()
    curve = judged_curve(run, REQUIREMENT, world)
    decided = decisive(run, REQUIREMENT, curve).time_s
    path = run.trajectory
    away = np.hypot(path.human_x - path.x[:, None], path.human_y - path.y[:, None]).min(axis=1)
    assert away[np.searchsorted(path.t, decided - 0.5)] < np.quantile(away, 0.25)


def test_a_minimum_is_decided_where_it_passes_its_limit() -> None:
    run, world = a_run(), warehouse()
    gap = Sampled(run, run.trajectory).closest_gap
    limit = float(np.quantile(gap, 0.2))
    least = REQUIREMENT.replace(metric="min_distance", limit=limit)
    decided = decisive(run, least, judged_curve(run, least, world)).time_s
    first = float(run.trajectory.t[int((gap < limit).argmax())])
    assert abs(decided - first) <= float(run.trajectory.t[-1]) / 70


def test_only_people_who_come_near_have_a_colour() -> None:
    run = a_run()
    closest = Sampled(run, run.trajectory).gap.min(axis=0)
    colours = people_colours([run])
    for name, gap in zip(run.human_names, closest, strict=True):
        assert (colours[name] is None) == (gap > INVOLVED_M)


@pytest.mark.parametrize("count", [1, 8, 9, 30, 60])
def test_no_two_people_share_a_colour(count: int) -> None:
    colours = distinct_colours(count)
    assert len(set(colours)) == count
    channels = [tuple(int(c[k : k + 2], 16) for k in (1, 3, 5)) for c in colours]
    nearest = (
        min(
            (sum((a - b) ** 2 for a, b in zip(one, two, strict=True)) ** 0.5)
            for i, one in enumerate(channels)
            for two in channels[:i]
        )
        if count > 1
        else 99.0
    )
    assert nearest > (12 if count <= 30 else 5)


def test_a_page_of_300_runs_stays_below_3_mb() -> None:
    the_plan, attempts, ledger = default_campaign()
    runs = sum(len(attempt.measurements) for attempt in attempts)
    empty, whole = len(page(the_plan, [], ledger).encode()), len(default_page().encode())
    assert runs > 20 and empty + 300 * (whole - empty) / runs < 3_000_000


@pytest.mark.parametrize("name", [each.id for each in METRICS.values() if each.so_far is not None])
@pytest.mark.parametrize("people", [0, 2])
def test_what_a_metric_gives_at_once_for_every_moment_is_what_it_measures_of_each_beginning(
    name: str, people: int
) -> None:
    rng = np.random.default_rng(5)
    t = np.cumsum(rng.uniform(0.04, 0.06, 60))
    walks = [tuple(rng.normal(size=(4, 60))) for _ in range(people)]
    v = np.where(rng.random(60) < 0.3, 0.0, rng.random(60))
    series = trajectory(t, np.cumsum(v), rng.normal(size=60), yaw=rng.normal(size=60), v=v, humans=walks)
    run = run_of(series, outcome=Outcome.REACHED)
    known = METRICS[name]
    assert known.so_far is not None
    at_once = known.so_far(Sampled(run, series))
    for end in range(2, 61):
        one = known.measure(prefix(run, end))
        assert at_once[end - 1] == pytest.approx(np.nan if one is None else one, abs=1e-9, nan_ok=True)
