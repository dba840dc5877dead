"""How closely the built-in stacks follow the real Nav2 on the same scenarios, with the same sensors and people.

    python benchmarks/nav2_agreement.py --launch 'ros2 launch nav2_bringup navigation_launch.py use_sim_time:=True
        params_file:={params}' [--speed 4] [--stacks nav2-dwb nav2-rpp nav2-mppi] [--suite examples/suites/warehouse]
        [--scenarios FILE.json ...] [--routes route_1 ...] [--runs 10] [--own-runs 30]
        [--keep DIR] [--json FILE]

For every stack the real Nav2 is started with the parameters that the built-in one has (`rvsg ros2 new-params`), and
the built-in one reads the same file. Without --launch the Nav2 that runs is measured as it is, against every stack.
Scenarios are the cases of a suite, with their requirements, files, or else the five routes of the warehouse without
people. --keep keeps the runs in a folder and goes on from there. Exit code 3 where there is no Nav2.

For each scenario: path RMS (m) between mean paths of the same seeds at equal shares of the way, time, recoveries, share
that reached the goal, the requirement's value and the share that violates it; beside it the same between two halves of
the real one's runs, which is how far it agrees with itself. Over all: rank correlations of the means, and in how many
scenarios a Kolmogorov-Smirnov test tells the two apart.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

SAMPLES = 100
NO_NAV2 = 3
P_VALUE = 0.05


@dataclass(frozen=True)
class Question:
    """One scenario, and the requirement it is judged by, if any."""

    name: str
    scenario: Any
    requirement: Any = None


def main() -> int:
    """Measure, print and write the table."""
    given = arguments()
    from rvsg.api.errors import RvsgError
    from rvsg.cli.options import pairs

    options = pairs("stack", given.stack_option)
    if given.launch is not None:
        options |= {"launch": given.launch, "speed": given.speed}
    if reason := missing(options):
        print(f"not measured: {reason}", file=sys.stderr)
        return NO_NAV2
    questions, own_runs = asked(given), given.own_runs or given.runs
    found: dict[str, Any] = {"runs": given.runs, "speed": given.speed, "stacks": {}}
    try:
        for name in given.stacks:
            rows: list[dict[str, Any]] = []
            real = real_runs(name, options, given)
            for question in questions:
                own = kept(given.keep, f"{question.name}-{name}", question, runs_of(question, own_runs, real.built_in))
                rows.append(compared(question, kept(given.keep, real.key(question), question, real.of(question)), own))
                print(json.dumps(rows[-1]), flush=True)
            real.close()
            found["stacks"][name] = {"scenarios": rows, "over_all": over_all(rows)}
    except RvsgError as error:
        print(f"stopped: {error}", file=sys.stderr)
    print(json.dumps({name: each["over_all"] for name, each in found["stacks"].items()}, indent=1))
    if given.json is not None:
        given.json.write_text(json.dumps(found, indent=1) + "\n")
    return 0


def arguments() -> argparse.Namespace:
    """Return what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--launch")
    parser.add_argument("--speed", type=float, default=1.0)
    parser.add_argument("--release", default="jazzy")
    parser.add_argument("--stacks", nargs="*", default=["nav2-dwb", "nav2-rpp", "nav2-mppi"])
    parser.add_argument("--suite", type=Path)
    parser.add_argument("--scenarios", nargs="*", type=Path, default=[])
    parser.add_argument("--routes", nargs="*", default=[])
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument("--own-runs", type=int, help="of the built-in stack [as --runs]")
    parser.add_argument("--stack-option", action="append", default=[])
    parser.add_argument("--keep", type=Path)
    parser.add_argument("--json", type=Path)
    return parser.parse_args()


def missing(options: dict[str, Any]) -> str:
    """Return why no real Nav2 can be measured here; empty where it can."""
    from rvsg.api.errors import RvsgError
    from rvsg.api.ros2 import check_ros2

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
    from rvsg.api.suites import Suite, requirement_of

    questions = [Question(path.stem, rvsg.load_scenario(path)) for path in given.scenarios]
    if given.suite is not None:
        for case in Suite.open(given.suite).cases:
            requirement = requirement_of(case.expectations[0], given.suite, case.scenario.mission.route)
            questions.append(Question(case.name, case.scenario, requirement))
    if questions:
        return questions
    world = rvsg.load_world("warehouse")
    routes = [route for route in world.routes if not given.routes or route.name in given.routes]
    return [Question(f"{route.name}-empty", rvsg.scenario(world, route.name, [])) for route in routes]


class Real:
    """Runs of the real Nav2 with one set of parameters; one connection for all scenarios."""

    def __init__(self, label: str, built_in: str, options: dict[str, Any], runs: int) -> None:
        self.label, self.options, self.runs = label, options, runs
        self.built_in = built_in
        """The stack to compare with: the parameter file, where it is known."""
        self._stack: Any = None

    def key(self, question: Question) -> str:
        """Return the name under which runs are kept."""
        return f"{question.name}-{self.label}"

    def of(self, question: Question) -> Callable[[], list[Any]]:
        """Return a function that makes the runs of a scenario."""

        def make() -> list[Any]:
            import rvsg
            from rvsg.stacks import StackChoice

            if self._stack is None:
                self._stack = StackChoice.of("ros2", self.options).driver
            made = list(rvsg.simulate(question.scenario, self.runs, stack=self._stack, on_message=say))
            for seed, run in enumerate(made):
                told = run.details["stack"].get("warnings")
                say(f"{question.name}, {self.label}, run {seed}: {run.outcome.value}, {told}")
            return made

        return make

    def close(self) -> None:
        """End the Nav2 that was started."""
        if self._stack is not None:
            self._stack.close()


def real_runs(name: str, options: dict[str, Any], given: argparse.Namespace) -> Real:
    """Return the real Nav2: started with the parameters of a built-in stack, or the one that runs."""
    from rvsg.api.ros2 import new_nav2_params

    if "launch" not in options:
        return Real("running", name, options, given.runs)
    file = Path(tempfile.mkdtemp(prefix="rvsg-agreement-")) / f"{name}.yaml"
    file.write_text(new_nav2_params(stack=name, release=given.release))
    return Real(f"real-{name}", str(file), {**options, "params": str(file)}, given.runs)


def runs_of(question: Question, runs: int, stack: str) -> Callable[[], list[Any]]:
    """Return a function that makes the runs of a built-in stack."""

    def make() -> list[Any]:
        import rvsg

        return list(rvsg.simulate(question.scenario, runs, stack=stack))

    return make


def kept(folder: Path | None, name: str, question: Question, make: Callable[[], list[Any]]) -> list[Any]:
    """Return the runs of that name in the folder, made and kept where they are not there yet."""
    from rvsg.api.simulating import RunSet, load_runs

    file = None if folder is None else folder / f"{name}.jsonl"
    if file is not None and file.is_file():
        return list(load_runs(file, scenario=question.scenario))
    runs = make()
    if file is not None:
        RunSet(tuple(runs)).save(file)
    return runs


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
        "path_rms_m": path_rms(real, own[: len(real)]),
        "path_rms_of_halves_m": path_rms(real[::2], real[1::2]),
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
        "recoveries": float(np.mean([run.recoveries for run in runs])),
        "reached": float(np.mean([run.completed for run in runs])),
        "outcomes": sorted({run.outcome.value for run in runs}),
    }
    told = [run.details.get("stack", {}) for run in runs]
    if any("missed_periods" in each for each in told):
        found["missed_share"] = float(np.mean([missed(each) for each in told]))
        found["speed"] = float(np.mean([each.get("speed", 0.0) for each in told]))
        found["turned_back"] = int(sum(each.get("turned_back", 0) for each in told))
    if question.requirement is not None:
        from rvsg.api.evaluating import judge
        from rvsg.api.simulating import RunSet

        judged = judge(RunSet(tuple(runs)), question.requirement, scenario=question.scenario)
        values = [measured.objective for measured in judged.measurements]
        found["values"] = [round(value, 4) for value in values if value is not None]
        found["violated"] = judged.violation_probability
    return found


def missed(told: dict[str, Any]) -> float:
    """Return the share of control periods that a run missed."""
    periods = told.get("missed_periods", 0) + told.get("commands", 0)
    return float(told.get("missed_periods", 0) / periods) if periods else 0.0


def p_value(one: Sequence[float], other: Sequence[float]) -> float | None:
    """Return the p-value of a Kolmogorov-Smirnov test; None where one side is empty."""
    return float(stats.ks_2samp(one, other).pvalue) if one and other else None


def mean_path(runs: list[Any]) -> np.ndarray:
    """Return the mean path at equal shares of the travelled length, (SAMPLES, 2)."""
    paths = []
    for run in runs:
        x, y = run.trajectory.x, run.trajectory.y
        along = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
        share = np.linspace(0.0, along[-1], SAMPLES)
        paths.append(np.column_stack([np.interp(share, along, x), np.interp(share, along, y)]))
    return np.mean(paths, axis=0)


def path_rms(one: list[Any], other: list[Any]) -> float | None:
    """Return the root mean square distance of two mean paths; None where one has no run."""
    if not one or not other:
        return None
    return float(np.sqrt(((mean_path(one) - mean_path(other)) ** 2).sum(axis=1).mean()))


def over_all(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return correlations over scenarios, and in how many of them a test tells the two apart."""
    judged = [row for row in rows if "ks_value_p" in row]
    return {
        "scenarios": len(rows),
        "path_rms_m": mean([row["path_rms_m"] for row in rows]),
        "path_rms_of_halves_m": mean([row["path_rms_of_halves_m"] for row in rows]),
        "time_difference_s": mean([difference(row, "times_s") for row in rows]),
        "rank_correlation_time": correlation(rows, "times_s"),
        "rank_correlation_value": {
            name: correlation([row for row in judged if row["requirement"] == name], "values")
            for name in sorted({row["requirement"] for row in judged})
        },
        "violated_real": mean([row["real"]["violated"] for row in judged]),
        "violated_built_in": mean([row["built_in"]["violated"] for row in judged]),
        "told_apart_by_time": sum((row["ks_time_p"] or 1.0) < P_VALUE for row in rows),
        "told_apart_by_value": sum((row["ks_value_p"] or 1.0) < P_VALUE for row in judged),
    }


def difference(row: dict[str, Any], key: str) -> float:
    """Return by how much the mean of the built-in stack exceeds that of the real one."""
    return float(np.mean(row["built_in"][key]) - np.mean(row["real"][key]))


def mean(values: Sequence[float | None]) -> float | None:
    """Return the mean of what is known."""
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def correlation(rows: list[dict[str, Any]], key: str) -> float | None:
    """Return Spearman's correlation of the means; None for fewer than three scenarios."""
    pairs = [(np.mean(r["real"][key]), np.mean(r["built_in"][key])) for r in rows if r["real"][key]]
    if len(pairs) < 3:
        return None
    return float(stats.spearmanr([a for a, _ in pairs], [b for _, b in pairs]).statistic)


if __name__ == "__main__":
    sys.exit(main())
