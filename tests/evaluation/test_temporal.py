from __future__ import annotations

import importlib.util
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.evaluation.runs import run_of, trajectory

from rvsg.evaluation.metrics import METRICS
from rvsg.evaluation.signals import SIGNALS, aim_of, formula, least_room, robustness, series_name, series_of
from rvsg.evaluation.temporal import FormulaError, body_of, joined_in
from rvsg.evaluation.temporal_grammar import parse
from rvsg.evaluation.verdict import objective
from rvsg.scenario.requirement import Aim, Requirement, load_requirement, shipped_requirements
from rvsg.world.world_folder import load_world

NAMES = ("a", "b")
BOUNDS = st.tuples(st.integers(0, 4), st.integers(0, 4)).map(sorted)


def interval():
    return st.one_of(st.just(""), BOUNDS.map(lambda b: f"[{b[0]},{b[1]}]"))


ATOM = st.tuples(st.sampled_from(NAMES), st.sampled_from(["<", ">"]), st.integers(-2, 2)).map(
    lambda p: f"({p[0]} {p[1]} {p[2]})"
)


def grow(part):
    return st.one_of(
        st.tuples(st.sampled_from(["and", "or", "implies"]), part, part).map(lambda p: f"({p[1]} {p[0]} {p[2]})"),
        st.tuples(st.sampled_from(["always", "eventually"]), interval(), part).map(lambda p: f"({p[0]}{p[1]} {p[2]})"),
        st.tuples(part, interval(), part).map(lambda p: f"({p[0]} until{p[1]} {p[2]})"),
        part.map(lambda p: f"(not {p})"),
    )


FORMULAS = st.recursive(ATOM, grow, max_leaves=4)
SERIES = st.lists(st.tuples(st.integers(-3, 3), st.integers(-3, 3)), min_size=1, max_size=7)


def by_definition(node, k, time, signals):
    """Robustness straight from the definition, one sample at a time."""

    def part(number, at):
        return by_definition(node.parts[number], at, time, signals)

    if node.kind == "room":
        return float(node.values(time, signals)[k])
    if node.kind == "not":
        return -part(0, k)
    if node.kind in ("and", "or"):
        return (min if node.kind == "and" else max)(part(0, k), part(1, k))
    inside = [j for j in range(k, len(time)) if node.interval.low <= time[j] - time[k] <= node.interval.high]
    if node.kind == "always":
        return min((part(0, j) for j in inside), default=math.inf)
    if node.kind == "eventually":
        return max((part(0, j) for j in inside), default=-math.inf)
    taken = (min(part(1, j), min((part(0, i) for i in range(k, j)), default=math.inf)) for j in inside)
    return max(taken, default=-math.inf)


@settings(max_examples=150, deadline=None)
@given(FORMULAS, SERIES, st.integers(0, 10**6))
def test_values_are_those_of_the_definition_on_uneven_samples_too(text, series, seed):
    rng = np.random.default_rng(seed)
    time = np.cumsum(rng.choice([0.25, 0.5, 1.0, 2.0], size=len(series)))
    signals = {name: np.array([float(s[i]) for s in series]) for i, name in enumerate(NAMES)}
    node = parse(text, NAMES)
    expected = [by_definition(node, k, time, signals) for k in range(len(time))]
    assert node.values(time, signals).tolist() == expected


@pytest.mark.skipif(importlib.util.find_spec("rtamt") is None, reason="rtamt is not installed (development only)")
@pytest.mark.filterwarnings("ignore")
@settings(max_examples=40, deadline=None)
@given(FORMULAS, SERIES.filter(lambda series: len(series) > 1))  # rtamt fails on a single sample
def test_values_are_those_of_an_established_monitor(text, series):
    import rtamt

    time = np.arange(len(series), dtype=float)
    signals = {name: np.array([float(s[i]) for s in series]) for i, name in enumerate(NAMES)}
    monitor = rtamt.StlDiscreteTimeSpecification()
    for name in NAMES:
        monitor.declare_var(name, "float")
    monitor.spec = text
    monitor.set_sampling_period(1, "s", 0.1)
    monitor.parse()
    data = {"time": list(range(len(series)))} | {name: values.tolist() for name, values in signals.items()}
    theirs = [value for _, value in monitor.evaluate(data)]
    assert parse(text, NAMES).values(time, signals).tolist() == pytest.approx(theirs)


def value(text, **signals):
    arrays = {name: np.asarray(values, float) for name, values in signals.items()}
    time = np.arange(len(next(iter(arrays.values()))), dtype=float)
    return parse(text, tuple(arrays)).values(time, arrays)[0]


@pytest.mark.parametrize(
    ("loose", "strict"),
    [
        ("a > 0 and b > 0 or a > 1", "((a > 0) and (b > 0)) or (a > 1)"),
        ("a > 0 implies b > 0 implies a > 1", "(a > 0) implies ((b > 0) implies (a > 1))"),
        ("always a > 0 and b > 0", "(always (a > 0)) and (b > 0)"),
        ("not a > 0 or b > 0", "(not (a > 0)) or (b > 0)"),
        ("a > 0 until b > 0 and a > 1", "((a > 0) until (b > 0)) and (a > 1)"),
        ("a + 2 * b > -a", "(a + (2 * b)) > (-a)"),
        ("a > 0 -> b > 0 || !(a > 1)", "(a > 0) implies ((b > 0) or (not (a > 1)))"),
    ],
)
def test_precedence_is_as_documented(loose, strict):
    assert parse(loose, NAMES) == parse(strict, NAMES)


def test_arithmetic_and_functions():
    assert value("abs(a) - 1 < max(a, 2)", a=[-3]) == 0
    assert value("always[0, 1 s] (a + 1) / 2 > 0", a=[1, 3, -9]) == 1
    assert value("min(a, 1) > 0", a=[5]) == 1


@pytest.mark.parametrize(
    ("text", "position", "code"),
    [
        ("always (distance_to_preson > 0.5)", 9, "formula-signal"),
        ("always (speed > 0.5", 20, "formula-open"),
        ("speed", 1, "formula-is-number"),
        ("always speed", 8, "formula-operand"),
        ("speed > 0.1 speed", 13, "formula-rest"),
        ("speed == 0.1", 7, "formula-equality"),
        ("0 < speed < 1", 11, "formula-comparisons"),
        ("always[5, 2] speed > 0", 7, "formula-interval"),
        ("always[-1, 2] speed > 0", 8, "formula-interval"),
        ("speed > ", 8, "formula-ends"),
        ("", 1, "formula-ends"),
        ("speed > 0 and", 14, "formula-ends"),
        ("(speed > 0) + 1 > 2", 1, "formula-operand"),
        ("speed # 1", 7, "formula-character"),
        ("__import__(1) > 1", 1, "formula-signal"),
        ("abs(speed, 1) > 1", 1, "formula-values"),
        ("1 > 2", 1, "formula-constant"),
        ("always (speed < 1 and max(1, 2) > -3)", 23, "formula-constant"),
        ("speed < 1/0", 11, "formula-division"),
        ("speed < 1/(2 - 2)", 11, "formula-division"),
        ("speed < 1e999", 9, "formula-large"),
        ("(" * 100 + "speed > 0" + ")" * 100, 42, "formula-deep"),
    ],
)  # fmt: skip
def test_a_formula_that_cannot_be_read_says_where_and_why(text, position, code):
    with pytest.raises(FormulaError) as caught:
        parse(text, tuple(SIGNALS))
    assert (caught.value.code, caught.value.position) == (code, position)
    assert str(caught.value).endswith(" " * (position - 1) + "^")


@settings(max_examples=200, deadline=None)
@given(st.text(alphabet="ab()[]<>=!&|+-*/,. 0123456789 andorutilnwyse", max_size=40))
def test_no_text_does_anything_but_parse_or_say_why_not(text):
    try:
        node = parse(text, NAMES)
    except FormulaError:
        return
    with np.errstate(all="ignore"):
        assert len(node.values(np.arange(3.0), {"a": np.ones(3), "b": np.zeros(3)})) == 3


@pytest.mark.parametrize(
    "text", ["-speed < 0", "abs(speed) > 1", "1 < max(0, speed)", "(speed) / 2 < 1", "speed < speed / speed"]
)
def test_a_formula_that_depends_on_a_signal_anywhere_is_read(text):
    parse(text, tuple(SIGNALS))


def test_the_robustness_of_a_run_is_the_room_left_at_its_worst_moment_if_it_has_one():
    run = run_of(trajectory([0, 1, 2], 0, v=[0.5, 0.5, 0.05], humans=[(np.array([3.0, 1.5, 1.0]), 0)]))
    assert robustness(run, "always (distance_to_person > 0.5 or speed < 0.1)") == pytest.approx(0.05)
    assert robustness(run, "always distance_to_person > 0.5") == pytest.approx(-0.25)
    assert robustness(run, "eventually[0, 5] distance_to_person < 0.5") == pytest.approx(0.25)

    alone = run_of(trajectory([0, 1], 0))
    assert robustness(alone, "always distance_to_person > 0.5") is None
    assert robustness(alone, "always[10, 20] speed < 0.5") is None
    assert robustness(alone, "always speed < 0.5") == 0.5


def test_clearance_needs_the_world_and_then_knows_shelves():
    world = load_world("warehouse")
    start = world.route("route_1").start
    run = run_of(trajectory([0, 1], start.x, start.y, humans=[(50.0, 50.0)]))
    requirement = Requirement(name="c", title="c", text="c", formula="always clearance > 0")
    assert objective(run, requirement) is None
    assert 0.0 < objective(run, requirement, world=world) < 5.0


T = np.arange(0.0, 5.0, 0.05)


def asking(metric: str | None = None, formula: str | None = None) -> Requirement:
    return Requirement(name="X", title="X", text="X", metric=metric, formula=formula)


@pytest.mark.parametrize(
    ("name", "aim"),
    [
        ("R1", Aim.SHARE),
        ("R2", Aim.DISTURB),
        ("R3", Aim.DELAY),
        ("clearance", Aim.MEET),
        ("deadlock", Aim.DELAY),
        ("arrival", Aim.DELAY),
        ("detour", Aim.DELAY),
        ("emergency_stops", Aim.DISTURB),
        ("slow_near_people", Aim.MEET),
        ("recovers_distance", Aim.MEET),
    ],
)
def test_the_aim_of_a_shipped_requirement_is_that_of_its_metric_or_signals(name: str, aim: Aim) -> None:
    assert aim_of(load_requirement(name)) is aim


def test_every_shipped_requirement_has_an_aim_and_a_series() -> None:
    for requirement in shipped_requirements().values():
        assert aim_of(requirement) in (Aim.SHARE, Aim.MEET, Aim.DISTURB, Aim.DELAY)
        assert series_name(requirement)

    for metric in METRICS.values():
        assert metric.shown in SIGNALS and metric.moved_by and metric.aim is not Aim.NONE

    assert aim_of(asking("time_near_goal_stop")) is None
    assert aim_of(None) is None
    assert aim_of(asking(formula="always (time < 3 or speed > 0.1)")) is Aim.DELAY
    assert aim_of(asking(formula="always abs(acceleration) < 3")) is Aim.DISTURB


def test_the_series_of_a_metric_is_the_signal_it_declares() -> None:
    run = run_of(trajectory(T, np.linspace(0, 3, len(T)), v=0.6, humans=[(6.0, 0.0)]), goal=(4.0, 0.0, 0.0))
    assert series_of(run, asking("trg"))[0] == pytest.approx(4.0)
    assert series_of(run, asking("dto"))[0] == pytest.approx(6.0)
    assert series_of(run, asking("jerk")).tolist() == [0.0] * len(T)


def test_the_series_of_a_formula_is_the_room_left_at_each_moment() -> None:
    speed = np.where(T < 2, 0.5, 0.1)
    run = run_of(trajectory(T, 0.0, v=speed))
    formula = "always speed < 0.3"
    found = series_of(run, asking(formula=formula))
    assert found == pytest.approx(0.3 - speed)
    assert found.min() == pytest.approx(robustness(run, formula))

    assert np.isnan(series_of(run_of(trajectory(T, 0.0)), asking("dto"))).all()
    assert len(series_of(run_of(trajectory(np.empty(0), np.empty(0))), asking("dto"))) == 0


def test_a_formula_tells_when_it_has_least_room_and_the_room_of_each_part() -> None:
    run = run_of(trajectory(T, 0.0, v=np.linspace(0.5, 0.1, len(T)), humans=[(np.linspace(6.0, 2.0, len(T)), 0.0)]))
    text = "always (centre_distance > 1 and (speed < 0.3 or centre_distance > 5) and abs(turn_rate) < 2)"
    found = least_room(run, asking(formula=text))
    assert found is not None
    time, parts = found
    k = int(np.nanargmin(series_of(run, asking(formula=text))))
    assert time == pytest.approx(T[k], abs=0.05) and list(parts) == [
        "(centre_distance > 1)", "(0.3 > speed)", "(centre_distance > 5)", "(2 > abs(turn_rate))",
    ]  # fmt: skip
    room = list(parts.values())
    away, speed = 6.0 - 4.0 * k / (len(T) - 1), 0.5 - 0.4 * k / (len(T) - 1)
    assert room == pytest.approx([away - 1.0, 0.3 - speed, away - 5.0, 2.0], abs=0.01)
    again = formula(f"always ({' and '.join(parts)})")
    assert [str(part) for part in joined_in(body_of(again))] == list(parts)
    assert least_room(run, asking("dto")) is None and least_room(run, asking(formula="always speed < 1")) is None
    nested = "always[0, 2] (not (speed < 1) until[1, 3] -x > min(y, 1))"
    assert str(formula(str(formula(nested)))) == str(formula(nested))
