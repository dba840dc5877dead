from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.campaign.parts import REQUIREMENT, KinematicSimulator, WalkGenerator, measure, plan, warehouse
from tests.evaluation.runs import run_of, trajectory

from rvsg.evaluation.realism import motions, rarest
from rvsg.evaluation.sampled import sampled
from rvsg.evaluation.story import story_of
from rvsg.evaluation.verdict import Verdict, judge
from rvsg.findings.feedback import decisive_moments, feedback_of, separable
from rvsg.generation.result_facts import feedback_facts
from rvsg.runs.attempt import Attempt
from rvsg.runs.observation import passings_of, stops_of, touches_of
from rvsg.scenario.brief import Brief, Feedback, PersonAt, Row
from rvsg.simulation.events import Recovery
from rvsg.simulation.run import Run


def verdict(*values: float) -> Verdict:
    return judge(REQUIREMENT, values)


def attempt_of(seed: int, runs: int = 3) -> tuple[Attempt, list[Run]]:
    brief = Brief(mission=plan().mission, requirement=REQUIREMENT, seed=seed)
    proposal = WalkGenerator().propose(brief, warehouse())
    assert proposal.scenario is not None
    made = [KinematicSimulator().run(proposal.scenario, warehouse(), seed=k) for k in range(runs)]
    measurements = tuple(measure(run) for run in made)
    values = [m.objective for m in measurements]
    how = {"campaign": "test", "index": 0, "strategy": "study", "brief": brief, "proposal": proposal}
    return Attempt(**how, measurements=measurements, verdict=judge(REQUIREMENT, values)), made


def told_of(attempt: Attempt, runs: list[Run], previous: Attempt | None = None) -> Feedback:
    return feedback_of(attempt, runs, requirement=REQUIREMENT, world=warehouse(), previous=previous)


def gaps(run: Run) -> np.ndarray:
    return sampled(run, warehouse()).gap


def a_run(gap: np.ndarray, v: np.ndarray | None = None) -> Run:
    """One human straight ahead of a robot at the origin, `gap` metres away edge to edge, at 10 Hz."""
    path = trajectory(np.arange(len(gap)) / 10, 0.0, v=0.5 if v is None else v, humans=[(gap + 0.75, 0.0)])
    return run_of(path, time_limit_s=60.0)


def test_the_feedback_tells_every_value_the_mean_and_the_share_of_violations_and_needs_an_objective() -> None:
    attempt, runs = attempt_of(1)
    told = told_of(attempt, runs)
    values = [m.objective for m in attempt.measurements]
    assert told.objectives == tuple(values)
    assert told.mean == pytest.approx(np.mean(values))
    assert told.violation_share == sum(v < 1.0 for v in values) / 3
    assert told.previous_mean is None and told.separable is None
    assert told.mildest == max(told.objectives) and told.mildest_parts
    # A single run has no interval and is never separable.
    attempt, runs = attempt_of(1, runs=1)
    before, _ = attempt_of(2, runs=1)
    told = told_of(attempt, runs, before)
    assert told.interval == (told.mean, told.mean)
    assert told.previous_mean == before.mean and told.separable is False
    assert told.mildest is None and told.mildest_parts == ()
    with pytest.raises(ValueError):
        told_of(attempt_of(0, runs=0)[0], [])


def test_separable_is_welchs_t_test_at_five_percent() -> None:
    from scipy.stats import ttest_ind

    chance = np.random.default_rng(5)
    seen = set()
    for shift in np.linspace(0, 3, 40):
        a, b = chance.normal(size=4), chance.normal(shift, 1.5, size=6)
        expected = bool(ttest_ind(a, b, equal_var=False).pvalue < 0.05)
        assert separable(verdict(*a), verdict(*b)) is expected
        seen.add(expected)
    assert seen == {True, False}
    assert separable(verdict(1.0, 1.0), verdict(2.0, 2.0)) is True
    assert separable(verdict(1.0, 1.0), verdict(1.0, 1.0)) is False


def test_the_closest_approach_is_a_decisive_moment_and_touches_are_told_with_place_and_human() -> None:
    gap = 3.0 - 2.9 * np.exp(-(((np.arange(200) - 120) / 20) ** 2))
    moments = decisive_moments(a_run(gap), warehouse())
    closest = next(m for m in moments if "closest approach" in m.note)
    assert (closest.time_s, closest.closest_human) == (12.0, "Human 1")
    assert closest.gap_m == pytest.approx(0.1)
    assert closest.robot_at == warehouse().grid.nearest(0.0, 0.0)
    assert [m.time_s for m in moments] == sorted(m.time_s for m in moments)
    gap = np.full(200, 3.0)
    gap[50:60] = gap[150] = -0.01
    first, second = touches_of(a_run(gap), warehouse())
    assert (first.who, first.time_s, first.until_s) == ("Human 1", 5.0, 5.9)
    assert first.at in warehouse().grid.valid
    assert second.time_s == 15.0
    assert touches_of(a_run(np.full(200, 3.0)), warehouse()) == ()


def test_a_stop_and_hard_braking_are_decisive_moments() -> None:
    v = np.full(200, 0.5)
    v[80:120] = 0.0
    moments = decisive_moments(a_run(np.full(200, 5.0), v), warehouse())
    notes = {note: m.time_s for m in moments for note in m.note.split("; ")}
    assert notes["stands still for 3.9 s from here"] == 8.0
    assert any(note.startswith("hardest braking") and 7.4 <= t <= 8.0 for note, t in notes.items())


def test_the_series_is_of_the_worst_run_and_names_everybodys_place_every_second() -> None:
    attempt, runs = attempt_of(3)
    told = told_of(attempt, runs)
    worst = min(runs, key=lambda run: measure(run).objective)
    assert attempt.worst(REQUIREMENT).run_id == worst.id
    path = worst.trajectory
    for sample in told.series[:: max(1, len(told.series) // 7)]:
        k = int(np.argmin(np.abs(path.t - sample.time_s)))
        nearest = float(np.hypot(path.human_x[k] - path.x[k], path.human_y[k] - path.y[k]).min())
        assert sample.robot_at == warehouse().grid.nearest(path.x[k], path.y[k])
        assert sample.value == pytest.approx(nearest, abs=1e-3)
    assert len(told.series) == int(path.t[-1]) + 1


def test_what_few_recorded_people_do_is_told_with_the_number_of_runs() -> None:
    attempt, runs = attempt_of(3)
    found = [rarest(motions(run)) for run in runs]
    told = told_of(attempt, runs)
    assert told.unusual_runs == sum(motion.is_rare for motion in found if motion is not None) > 0
    assert told.unusual == min((m for m in found if m), key=lambda motion: motion.recorded_percent).sentence


def test_a_waypoint_that_never_met_the_robot_is_idle_and_one_that_did_is_not() -> None:
    for seed in range(6):
        attempt, runs = attempt_of(seed)
        told = told_of(attempt, runs)
        for h, influence in enumerate(told.influences):
            assert influence.closest_gap_m == pytest.approx(min(gaps(run)[:, h].min() for run in runs))
            assert 0.0 <= influence.share_within_2_m <= 1.0
            if influence.closest_gap_m > 3.1:
                path = {w for t in attempt.proposal.scenario.people.humans[h].tasks for w in t.path}
                assert set(influence.idle_waypoints) == path
            if influence.closest_gap_m < 2.5:
                run, k = min(((r, int(gaps(r)[:, h].argmin())) for r in runs), key=lambda x: gaps(x[0])[x[1], h])
                at = warehouse().grid.nearest(run.trajectory.human_x[k, h], run.trajectory.human_y[k, h])
                assert at not in influence.idle_waypoints


@pytest.mark.parametrize(("gap_m", "said"), [(0.007, "closest approach"), (0.0, "contact"), (-0.01, "contact")])
def test_only_bodies_that_touch_are_said_to_be_in_contact(gap_m: float, said: str) -> None:
    run = a_run(np.abs(np.linspace(-2.0, 2.0, 41)) + gap_m)
    assert decisive_moments(run, warehouse())[0].note == said


RECOVERY = Recovery(time_s=9.0, x=0.0, y=0.0, until_s=12.0, action="spin")


@pytest.mark.parametrize(
    ("gap", "changes", "reason", "who"),
    [
        (0.6, {}, "person_ahead", "Human 1"),
        (1.5, {}, "unknown", ""),
        (3.0, {}, "unknown", ""),
        (3.0, {"events": (RECOVERY,)}, "recovery", ""),
        (0.6, {"goal": (1.35, 0.0, 0.0)}, "goal_taken", "Human 1"),
    ],
)
def test_a_stop_tells_why_the_robot_stands(gap: float, changes: dict[str, object], reason: str, who: str) -> None:
    speed = np.full(200, 0.5)
    speed[80:140] = 0.0
    (stop,) = stops_of(replace(a_run(np.full(200, gap), speed), **changes), warehouse())
    assert (stop.time_s, stop.reason, stop.who) == (8.0, reason, who)
    story = story_of(replace(a_run(np.full(200, gap), speed), **changes), world=warehouse())
    assert any(sentence.text.endswith(f", {stop.because}.") for sentence in story)
    assert stop.until_s == pytest.approx(13.9, abs=0.2)


def test_a_stop_has_the_reason_that_holds_for_most_of_it() -> None:
    speed, gap = np.full(200, 0.5), np.full(200, 3.0)
    speed[80:140], gap[78:90] = 0.0, 0.6  # somebody passes, and the recovery goes on
    recovery = RECOVERY.replace(time_s=9.0, until_s=14.0)
    (stop,) = stops_of(replace(a_run(gap, speed), events=(recovery,)), warehouse())
    assert (stop.reason, stop.because) == ("recovery", "in a recovery of its navigation")


def test_the_value_is_told_by_who_was_near_and_lost_time_by_who_was_near_meanwhile() -> None:
    attempt, runs = attempt_of(3)
    told = told_of(attempt, runs)
    currency = feedback_facts(told, REQUIREMENT, {})["currency"]
    assert currency is not None and currency[0] == "nearest"
    path = min(runs, key=lambda run: measure(run).objective).trajectory
    away = np.hypot(path.human_x - path.x[:, None], path.human_y - path.y[:, None])
    for h, name in enumerate(runs[0].human_names):
        assert currency[1].get(name, 0.0) == pytest.approx(100.0 * (away.argmin(axis=1) == h).mean(), abs=10.0)
    person = {"at": "F13", "doing": "pausing", "side": "ahead"}
    rows = tuple(
        Row(time_s=t, robot_at=at, people={"Human 1": PersonAt(**person, distance_m=d)})
        for t, at, d in ((0.0, "A1", 5.0), (4.0, "A2", 1.5), (8.0, "A3", 1.5), (12.0, "A4", 4.0))
    )
    late = REQUIREMENT.replace(metric="trg", unit="s", worse="larger", limit=9.0)
    passes = {"A1": (0.0, 1.0), "A2": (2.0, 2.0), "A3": (3.0, 3.0), "A4": (6.0, 6.0)}
    lost = feedback_facts(told.replace(rows=rows), late, passes)["currency"]
    assert lost == ("lost", {"Human 1": 5.0, "nobody": 1.0})  # 12 s at A4, which it passes at 6 s alone


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_side_on_which_somebody_is_passed_is_told(side: float) -> None:
    human = (np.linspace(5.0, -5.0, 200), side, np.pi, 0.5)
    run = run_of(trajectory(np.arange(200) / 10, 0.0, v=0.5, humans=[human]))
    (passing,) = passings_of(run, warehouse())
    assert (passing.left, passing.how) == (side > 0, "head-on")
    assert passing.time_s == pytest.approx(10.0, abs=0.3)
