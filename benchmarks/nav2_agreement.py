"""Agreement of the built-in stacks with the real Nav2 on the same scenarios, with the same sensors and people.

    python benchmarks/nav2_agreement.py --launch 'ros2 launch nav2_bringup navigation_launch.py use_sim_time:=True
        params_file:={params}' [--speed 4] [--stacks nav2-dwb nav2-rpp nav2-mppi] [--suite examples/suites/warehouse]
        [--scenarios FILE.json ...] [--world hospital] [--routes route_1 ...] [--runs 10] [--own-runs 30]
        [--keep DIR] [--json FILE] [--rows FILE]
    python benchmarks/nav2_agreement.py --stored benchmarks/results/nav2-agreement.csv

For every stack the real Nav2 is started with the parameters that the built-in one has (`rvsg ros2 new-params`), and
the built-in one reads the same file. Without --launch the Nav2 that runs is measured as it is, against every stack.
Scenarios are the cases of a suite, with their requirements, files, or else the routes of --world (shipped or a
folder; by default the warehouse) without people. --keep keeps every run in a folder and goes on from there, also with
more --runs. --rows writes every run as a line of CSV. Exit code 3 where there is no Nav2.

For each scenario: path RMS (m) between runs of the same seed at equal shares of the way, beside that between two seeds
of each; time, rounds of recovery, share that reached the goal, the requirement's value and the share that violates it.
Over all: rank correlations of the means, in how many scenarios two tests tell the two apart, and the mean difference.
Beside each is what chance gives: the runs of each scenario are relabelled at random, as if both were one stack. The
option --stored computes that from the lines that --rows wrote, without paths and violated shares.
"""

from __future__ import annotations

import argparse
import csv
import json
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy import stats

SAMPLES = 100
NO_NAV2 = 3
P_VALUE = 0.05
TESTS = {"Kolmogorov-Smirnov": stats.ks_2samp, "Mann-Whitney": stats.mannwhitneyu}
DRAWS = 1000
"""Relabellings of the runs; for tests, whose counts take long, a fifth of it."""
PATHS = ("path_m", "path_between_real_m", "path_between_built_in_m")
ROUND = "RecoveryActions"
"""Nav2's default trees call the outer recovery so."""


@dataclass(frozen=True)
class Question:
    """One scenario, and the requirement it is judged by, if any."""

    name: str
    scenario: Any
    world: Any
    requirement: Any = None


def main() -> int:
    """Measure, print and write the table."""
    given = arguments()
    if given.stored is not None:
        print(json.dumps({name: over_all(rows) for name, rows in stored(given.stored).items()}, indent=1))
        return 0
    from rvsg.cli.options import pairs
    from rvsg.core.errors import RvsgError

    options = pairs("stack", given.stack_option)
    if given.launch is not None:
        options |= {"launch": given.launch, "speed": given.speed}
    if reason := missing(options):
        print(f"not measured: {reason}", file=sys.stderr)
        return NO_NAV2
    questions, own_runs = asked(given), given.own_runs or given.runs
    found: dict[str, Any] = {"runs": given.runs, "speed": given.speed, "stacks": {}}
    lines: list[dict[str, Any]] = []
    try:
        for name in given.stacks:
            rows: list[dict[str, Any]] = []
            real = real_runs(name, options, given)
            for question in questions:
                own = kept(given.keep, f"{question.name}-{name}", question, built_in(question, own_runs, real.built_in))
                driven = kept(given.keep, real.key(question), question, real.of(question))
                rows.append(compared(question, driven, own))
                print(json.dumps(rows[-1]), flush=True)
                lines += [*each_run(name, "nav2", question, driven), *each_run(name, "built in", question, own)]
            real.close()
            found["stacks"][name] = {"scenarios": rows, "over_all": over_all(rows)}
    except RvsgError as error:
        print(f"stopped: {error}", file=sys.stderr)
    print(json.dumps({name: each["over_all"] for name, each in found["stacks"].items()}, indent=1))
    if given.json is not None:
        given.json.write_text(json.dumps(found, indent=1) + "\n")
    if given.rows is not None and lines:
        with given.rows.open("w", newline="") as file:
            table = csv.DictWriter(file, list(lines[0]), lineterminator="\n")
            table.writeheader()
            table.writerows(lines)
    return 0


def arguments() -> argparse.Namespace:
    """Return what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--launch")
    parser.add_argument("--speed", type=float, default=1.0)
    parser.add_argument("--release", default="jazzy")
    parser.add_argument("--stacks", nargs="*", default=["nav2-dwb", "nav2-rpp", "nav2-mppi"])
    parser.add_argument("--suite", type=Path)
    parser.add_argument("--cases", nargs="*", default=[], help="of the suite [all]")
    parser.add_argument("--scenarios", nargs="*", type=Path, default=[])
    parser.add_argument("--world", default="warehouse", help="of the routes and the suite [warehouse]")
    parser.add_argument("--routes", nargs="*", default=[])
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument("--own-runs", type=int, help="of the built-in stack [as --runs]")
    parser.add_argument("--stack-option", action="append", default=[])
    parser.add_argument("--keep", type=Path)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--rows", type=Path)
    parser.add_argument("--stored", type=Path)
    return parser.parse_args()


def missing(options: dict[str, Any]) -> str:
    """Return why no real Nav2 can be measured here; empty where it can."""
    from rvsg.core.errors import RvsgError
    from rvsg_ros2.check import check_ros2

    if "launch" in options:
        return ""
    try:
        found = check_ros2(options)
    except RvsgError as error:
        return str(error)
    lacking = [each.name for each in found.findings if each.status.name == "MISSING"]
    return "" if found.is_usable else f"no usable Nav2 in DDS domain {found.domain}: {', '.join(lacking)}"


def asked(given: argparse.Namespace) -> list[Question]:
    """Return the scenarios to drive."""
    import rvsg
    from rvsg.app.suites import Suite
    from rvsg.scenario.builder import load_scenario_in
    from rvsg.suites.suite_folder import requirement_of

    world = rvsg.load_world(given.world)
    stems = [path.stem for path in given.scenarios]
    names = [s if stems.count(s) == 1 else f"{p.parent.name}-{s}" for p, s in zip(given.scenarios, stems, strict=True)]
    questions = [Question(n, *load_scenario_in(p)) for p, n in zip(given.scenarios, names, strict=True)]
    if given.suite is not None:
        for case in Suite.open(given.suite).cases:
            if given.cases and case.name not in given.cases:
                continue
            requirement = requirement_of(case.expectations[0], given.suite, case.scenario.mission.route)
            questions.append(Question(case.name, case.scenario, world, requirement))
    if questions and not given.routes:
        return questions
    routes = [route for route in world.routes if not given.routes or route.name in given.routes]
    empty = {route.name: rvsg.scenario(world, route.name, []) for route in routes}
    return questions + [Question(f"{name}-empty", scenario, world) for name, scenario in empty.items()]


class Wanted(NamedTuple):
    """Runs, and how they are made: so many in one call, by their seeds."""

    runs: int
    at_once: int
    make: Callable[[list[int]], list[Any]]


class Nav2:
    """The real Nav2 behind the stack `ros2`: started or found for the first run, and kept for those that follow."""

    def __init__(self, options: dict[str, Any]) -> None:
        self.options = options
        self.stack: Any = None
        self._simulator: Any = None

    def prepare(self) -> None:
        """Start or find it, where that has not been done."""
        if self._simulator is None:
            from rvsg.simulation.simulators import make_simulator
            from rvsg.stacks import StackChoice

            self.stack = StackChoice.of("ros2", self.options).driver
            self._simulator = make_simulator("embedded", self.stack)
            self._simulator.prepare(say)

    def run(self, question: Question, seed: int) -> Any:
        """Return one run."""
        import rvsg

        self.prepare()
        how = {"simulator": self._simulator, "world": question.world, "on_message": say}
        return next(iter(rvsg.simulate(question.scenario, [seed], **how)))

    def close(self) -> None:
        """End it where it was started."""
        if self._simulator is not None:
            self._simulator.close()
            self._simulator = self.stack = None


class Real:
    """Runs of the real Nav2 with one set of parameters; one connection for all scenarios."""

    def __init__(self, label: str, built_in: str, options: dict[str, Any], runs: int) -> None:
        self.label, self.runs = label, runs
        self.built_in = built_in
        """The stack to compare with: the parameter file, where it is known."""
        self._nav2 = Nav2(options)

    def key(self, question: Question) -> str:
        """Return the name under which runs are kept."""
        return f"{question.name}-{self.label}"

    def of(self, question: Question) -> Wanted:
        """Return the runs of a scenario, which are made one by one."""
        return Wanted(self.runs, 1, lambda seeds: [self._one(question, seed) for seed in seeds])

    def _one(self, question: Question, seed: int) -> Any:
        run = self._nav2.run(question, seed)
        told = run.details["stack"].get("warnings")
        say(f"{question.name}, {self.label}, run {seed}: {run.outcome.value}, {told}")
        return run

    def close(self) -> None:
        """End the Nav2 that was started."""
        self._nav2.close()


def real_runs(name: str, options: dict[str, Any], given: argparse.Namespace) -> Real:
    """Return the real Nav2: started with the parameters of a built-in stack, or the one that runs."""
    from rvsg_ros2.nav2_file import new_nav2_params

    if "launch" not in options:
        return Real("running", name, options, given.runs)
    file = Path(tempfile.mkdtemp(prefix="rvsg-agreement-")) / f"{name}.yaml"
    file.write_text(new_nav2_params(stack=name, release=given.release))
    return Real(f"real-{name}", str(file), {**options, "params": str(file)}, given.runs)


def built_in(question: Question, runs: int, stack: str) -> Wanted:
    """Return the runs of a built-in stack, which are made at once."""
    import rvsg

    how = {"stack": stack, "world": question.world}
    return Wanted(runs, runs, lambda seeds: list(rvsg.simulate(question.scenario, seeds, **how)))


def kept(folder: Path | None, name: str, question: Question, wanted: Wanted) -> list[Any]:
    """Return the runs of that name in the folder; those that are not there yet are made and kept."""
    from rvsg.search.run_set import RunSet, load_runs

    file = None if folder is None else folder / f"{name}.jsonl"
    runs = list(load_runs(file)) if file is not None and file.is_file() else []
    while len(runs) < wanted.runs:
        runs += wanted.make(list(range(len(runs), min(len(runs) + wanted.at_once, wanted.runs))))
        if file is not None:
            RunSet(tuple(runs)).save(file)
    return runs[: wanted.runs]


def say(text: str) -> None:
    """Print to standard error."""
    print(text, file=sys.stderr, flush=True)


def compared(question: Question, real: list[Any], own: list[Any]) -> dict[str, Any]:
    """Return the figures of one scenario."""
    one, other = figures(real, question), figures(own, question)
    row: dict[str, Any] = {
        "scenario": question.name,
        "real": one,
        "built_in": other,
        "path_m": [path_rms(a, b) for a, b in zip(real, own, strict=False)],
        "path_between_real_m": [path_rms(a, b) for a, b in pairwise(real)],
        "path_between_built_in_m": [path_rms(a, b) for a, b in pairwise(own[: len(real)])],
        "ks_time_p": p_value(one["times_s"], other["times_s"]),
    }
    if question.requirement is not None:
        row["requirement"] = question.requirement.name
        row["ks_value_p"] = p_value(one["values"], other["values"])
    return row


def figures(runs: list[Any], question: Question) -> dict[str, Any]:
    """Return what is compared of the runs of one stack."""
    found: dict[str, Any] = {
        "times_s": [round(float(run.trajectory.t[-1]), 3) for run in runs],
        "rounds": float(np.mean([rounds(run) for run in runs])),
        "reached": float(np.mean([run.completed for run in runs])),
        "outcomes": sorted({run.outcome.value for run in runs}),
    }
    told = [run.details.get("stack", {}) for run in runs]
    if any("missed_periods" in each for each in told):
        found["missed_share"] = float(np.mean([missed(each) for each in told]))
        found["speed"] = float(np.mean([each.get("speed", 0.0) for each in told]))
        found["turned_back"] = int(sum(each.get("turned_back", 0) for each in told))
    if question.requirement is not None:
        from rvsg.search.run_set import RunSet, judge

        known = {"scenario": question.scenario, "world": question.world}
        judged = judge(RunSet(tuple(runs)), question.requirement, **known)
        values = [measured.objective for measured in judged.measurements]
        found["values"] = [round(value, 4) for value in values if value is not None]
        found["violated"] = judged.violation_probability
    return found


def each_run(stack: str, driver: str, question: Question, runs: list[Any]) -> list[dict[str, Any]]:
    """Return one line of the table for each run; `value` is the requirement's, empty where there is none."""
    values: list[Any] = [None] * len(runs)
    if question.requirement is not None:
        from rvsg.search.run_set import RunSet, evaluate

        known = {"scenario": question.scenario, "world": question.world}
        judged = evaluate(RunSet(tuple(runs)), question.requirement, **known)
        values = [measured.objective for measured in judged]
    return [
        {
            "stack": stack,
            "scenario": question.name,
            "requirement": getattr(question.requirement, "name", ""),
            "driver": driver,
            "run": k,
            "outcome": run.outcome.value,
            "time_s": round(float(run.trajectory.t[-1]), 3),
            "recoveries": rounds(run),
            "value": "" if value is None else round(value, 4),
            "missed_share": round(missed(run.details.get("stack", {})), 4) if driver == "nav2" else "",
        }
        for k, (run, value) in enumerate(zip(runs, values, strict=True))
    ]


def missed(told: dict[str, Any]) -> float:
    """Return the share of control periods that a run missed."""
    periods = told.get("missed_periods", 0) + told.get("commands", 0)
    return float(told.get("missed_periods", 0) / periods) if periods else 0.0


def p_value(one: Sequence[float], other: Sequence[float]) -> float | None:
    """Return the p-value of a Kolmogorov-Smirnov test; None where one side is empty."""
    return float(stats.ks_2samp(one, other).pvalue) if one and other else None


def rounds(run: Any) -> int:
    """Return how often the outer recovery of the default tree came; Nav2's own count has each cleared costmap."""
    changes = run.details.get("stack", {}).get("behaviour_tree")
    if changes is None:
        return int(run.recoveries)
    return sum(name == ROUND and status in ("SUCCESS", "FAILURE") for _, name, status in changes)


def path(run: Any) -> np.ndarray:
    """Return the path at equal shares of the travelled length, (SAMPLES, 2)."""
    x, y = run.trajectory.x, run.trajectory.y
    along = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
    share = np.linspace(0.0, along[-1], SAMPLES)
    return np.column_stack([np.interp(share, along, x), np.interp(share, along, y)])


def path_rms(one: Any, other: Any) -> float:
    """Return the root mean square distance of the paths of two runs, m."""
    return round(float(np.sqrt(((path(one) - path(other)) ** 2).sum(axis=1).mean())), 4)


def over_all(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return correlations over scenarios, in how many of them a test tells the two apart, and mean differences."""
    judged = [row for row in rows if "requirement" in row]
    by_requirement = {
        name: [row for row in judged if row["requirement"] == name]
        for name in sorted({row["requirement"] for row in judged})
    }
    return {
        "scenarios": len(rows),
        "path_median_m": {name: median(rows, name) for name in PATHS},
        "rank_correlation_time": correlation(rows, "times_s"),
        "rank_correlation_value": {name: correlation(of, "values") for name, of in by_requirement.items()},
        **{
            f"{name}_{side}": mean([row[side].get(name) for row in rows])
            for name in ("violated", "reached", "rounds")
            for side in ("real", "built_in")
        },
        "difference_time_s": difference(rows, "times_s"),
        "difference_value": {name: difference(of, "values") for name, of in by_requirement.items()},
        "told_apart_by_time": told_apart(rows, "times_s"),
        "told_apart_by_value": told_apart(judged, "values"),
    }


def stored(path: Path) -> dict[str, list[dict[str, Any]]]:
    """Return what `over_all` takes for each stack, from the lines that --rows wrote: scenarios with people."""
    found: dict[str, dict[str, Any]] = {}
    for line in csv.DictReader(path.read_text().splitlines()):
        if line["requirement"] and not line["scenario"].endswith("-again"):
            row = found.setdefault(line["stack"], {}).setdefault(
                line["scenario"],
                {key: {"times_s": [], "values": []} for key in ("real", "built_in")}
                | {"scenario": line["scenario"], "requirement": line["requirement"]},
            )
            side = row["real" if line["driver"] == "nav2" else "built_in"]
            side["times_s"].append(float(line["time_s"]))
            side["values"] += [float(line["value"])] if line["value"] else []
    return {stack: list(rows.values()) for stack, rows in found.items()}


class Sides(NamedTuple):
    """The numbers of one scenario."""

    real: np.ndarray
    own: np.ndarray

    def relabelled(self, chance: np.random.Generator) -> Sides:
        """Return the same numbers, each given to one of the two by chance."""
        mixed = chance.permutation(np.concatenate(self))
        return Sides(mixed[: len(self.real)], mixed[len(self.real) :])


def sides(rows: list[dict[str, Any]], key: str) -> list[Sides]:
    """Return the numbers of the scenarios in which both have some."""
    found = [Sides(np.array(row["real"][key]), np.array(row["built_in"][key])) for row in rows]
    return [each for each in found if len(each.real) and len(each.own)]


def against_chance(
    known: list[Sides], figure: Callable[[list[Sides]], float], draws: int = DRAWS
) -> tuple[float, np.ndarray]:
    """Return a figure of the scenarios, and what it is when the runs of each are relabelled."""
    chance = np.random.default_rng(0)
    return figure(known), np.array([figure([each.relabelled(chance) for each in known]) for _ in range(draws)])


def told_apart(rows: list[dict[str, Any]], key: str) -> dict[str, dict[str, float]]:
    """Return in how many scenarios each test tells the two apart, how many chance gives, and how likely so many are."""
    known, found = sides(rows, key), {}
    for name, test in TESTS.items():

        def count(these: list[Sides], test: Any = test) -> float:
            return float(sum(test(*each).pvalue < P_VALUE for each in these))

        counted, by_chance = against_chance(known, count, DRAWS // 5)
        found[name] = {"scenarios": counted, "chance": by_chance.mean(), "p": share(by_chance >= counted)}
    return found


def difference(rows: list[dict[str, Any]], key: str) -> dict[str, float] | None:
    """Return by how much the built-in stack's mean exceeds Nav2's, and two p-values: of it, and in units of the spread.

    Runs are relabelled within their scenario.
    """
    known = sides(rows, key)
    if not known:
        return None
    spread = [np.std(np.concatenate(each)) or 1.0 for each in known]

    def excess(these: list[Sides]) -> float:
        return float(np.mean([each.own.mean() - each.real.mean() for each in these]))

    def in_spreads(these: list[Sides]) -> float:
        return float(np.mean([(e.own.mean() - e.real.mean()) / s for e, s in zip(these, spread, strict=True)]))

    found, by_chance = against_chance(known, excess)
    scaled, scaled_by_chance = against_chance(known, in_spreads)
    return {
        "mean": found,
        "p": share(abs(by_chance) >= abs(found)),
        "p_in_spreads": share(abs(scaled_by_chance) >= abs(scaled)),
    }


def share(so: np.ndarray) -> float:
    """Return how likely it is by chance, of relabellings in which it is so; never 0."""
    return float((1 + so.sum()) / (1 + so.size))


def mean(values: Sequence[float | None]) -> float | None:
    """Return the mean of what is known."""
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def median(rows: list[dict[str, Any]], key: str) -> float | None:
    """Return the median over the runs of all scenarios."""
    values = [value for row in rows for value in row.get(key, ())]
    return float(np.median(values)) if values else None


def correlation(rows: list[dict[str, Any]], key: str) -> dict[str, Any] | None:
    """Return Spearman's correlation of the means over scenarios; None for fewer than three scenarios.

    Beside it, the mean and 95 % interval that a stack has with itself: of relabelled runs.
    """
    known = sides(rows, key)
    if len(known) < 3:
        return None

    def spearman(these: list[Sides]) -> float:
        real, own = ([float(np.mean(side)) for side in part] for part in zip(*these, strict=True))
        return float(stats.spearmanr(real, own).statistic)

    found, by_chance = against_chance(known, spearman)
    low, high = np.quantile(by_chance, (0.025, 0.975))
    return {"with_nav2": found, "with_itself": by_chance.mean(), "interval": [float(low), float(high)]}


if __name__ == "__main__":
    sys.exit(main())
