"""Agreement of the embedded simulator with the published study's runs.

    python benchmarks/fidelity.py DIR [--routes 1 2 3] [--seeds 4] [--repeats 29] [--jobs 2] [--json] [--quick]
                                   [--seed 0]

DIR is a folder laid out as the study's published results. Part A runs the best and worst scenarios again as often as
the study did; part B runs every single-run configuration with several seeds. The profile is `published-study`.

`spearman` is the mean over routes of the rank correlation within a route, between scenario means (part A) or between a
configuration's mean over seeds and its one published value (part B). `spearman_route_centred` (part A) is one
correlation over all scenarios, each less its route's mean. `ceiling` (part A) is what a simulator that draws from the
published distribution itself would reach: the mean correlation of resampled with published means, a little too high as
the same runs stand for the truth. `bias_sd` is simulated less published, in units of the mean within-route standard
deviation of the published single runs. `sd_ratio` is the mean within-scenario standard deviation, simulated over
published; `a12_distance` the mean of |A12 - 0.5|; `ks_share` the share of scenarios whose Kolmogorov-Smirnov test gives
p < 0.05. `rank_p` (part B) is the p-value of a chi-squared test that the rank of the published value among the
simulated ones is uniform, as it is where both come from one distribution. `expected_jerk` compares the simulator's
phase-averaged jerk with the published sampled one.

Runs are compared with runs of their kind: a simulated run takes its clock ratio from the logs of the same session,
people begin early as often as in the repeated or the single runs, and single runs in which human 2 stays where it began
are left out on both sides.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from fidelity_runs import METRICS, Results, map_folder, simulate_all, world_of
from published_runs import METHODS, Configuration, LeftOut, repeated, routes_in, singles
from rvsg.core.errors import InputError
from rvsg.evaluation.statistics import vargha_delaney

RESAMPLES = 200
QUICK_STEP = 3
QUICK_REPEATS = 8
QUICK_SEEDS = 2
ACCEPTED = Path(__file__).parent / "fidelity_accepted.json"


def spearman(a: Sequence[float], b: Sequence[float]) -> float | None:
    """The rank correlation; None where it is not defined (a constant, or fewer than three points)."""
    x, y = np.asarray(a, float), np.asarray(b, float)
    good = np.isfinite(x) & np.isfinite(y)
    if good.sum() < 3 or np.ptp(x[good]) == 0.0 or np.ptp(y[good]) == 0.0:
        return None
    return float(stats.spearmanr(x[good], y[good]).statistic)


def _mean(values: Iterable[float | None]) -> float | None:
    known = [v for v in values if v is not None and math.isfinite(v)]
    return float(np.mean(known)) if known else None


def _published(metric: str) -> str:
    return "jerk" if metric == "expected_jerk" else metric


def _by_route(configurations: Sequence[Configuration]) -> dict[str, list[Configuration]]:
    groups: dict[str, list[Configuration]] = {}
    for configuration in configurations:
        groups.setdefault(configuration.route, []).append(configuration)
    return groups


def _real(configuration: Configuration, metric: str) -> list[float]:
    return [run[_published(metric)] for run in configuration.runs]


def _simulated(results: Results, configuration: Configuration, metric: str) -> list[float]:
    return [run[metric] for run in results[configuration.key]]


def spread_within_routes(configurations: Sequence[Configuration], metric: str) -> float:
    """Mean over routes of the standard deviation of the published single runs."""
    spreads = [
        np.std([_real(c, metric)[0] for c in group], ddof=1)
        for group in _by_route(configurations).values()
        if len(group) > 1
    ]
    return float(np.mean(spreads)) if spreads else math.nan


def part_a(configurations: Sequence[Configuration], results: Results, metric: str, spread: float) -> dict[str, Any]:
    """The figures of the repeated scenarios for one metric."""
    within: list[float | None] = []
    centred: list[tuple[float, float]] = []
    per_route: dict[str, float | None] = {}
    for route, group in _by_route(configurations).items():
        real = np.array([np.mean(_real(c, metric)) for c in group])
        sim = np.array([np.nanmean(_simulated(results, c, metric)) for c in group])
        per_route[route] = spearman(real, sim)
        within.append(per_route[route])
        centred += list(zip(real - real.mean(), sim - sim.mean(), strict=True))
    pairs = [(_real(c, metric), _simulated(results, c, metric)) for c in configurations]
    bias = float(np.mean([np.nanmean(sim) - np.mean(real) for real, sim in pairs])) if pairs else math.nan
    real_sd = float(np.mean([np.std(real, ddof=1) for real, _ in pairs])) if pairs else math.nan
    sim_sd = float(np.mean([np.nanstd(sim, ddof=1) for _, sim in pairs])) if pairs else math.nan
    return {
        "spearman": _mean(within),
        "spearman_route_centred": spearman([a for a, _ in centred], [b for _, b in centred]),
        "spearman_by_route": per_route,
        "ceiling": ceiling(configurations, metric),
        "bias_sd": _finite(bias / spread if spread else math.nan),
        "bias": _finite(bias),
        "sd_ratio": _finite(sim_sd / real_sd if real_sd else math.nan),
        "a12_distance": _mean(abs(vargha_delaney(sim, real) - 0.5) for real, sim in pairs),
        "ks_share": _mean(float(stats.ks_2samp(real, sim).pvalue < 0.05) for real, sim in pairs),
    }


def ceiling(configurations: Sequence[Configuration], metric: str) -> float | None:
    """The mean within-route correlation of scenario means between the published runs and as many drawn from them."""
    rng = np.random.default_rng(0)
    found: list[float | None] = []
    for group in _by_route(configurations).values():
        runs = [np.asarray(_real(c, metric)) for c in group]
        means = [float(values.mean()) for values in runs]
        found.append(_mean(spearman([rng.choice(v, v.size).mean() for v in runs], means) for _ in range(RESAMPLES)))
    return _mean(found)


def rank_p(configurations: Sequence[Configuration], results: Results, metric: str) -> float | None:
    """How well the ranks of the published values among the simulated ones agree with uniform ones (p-value).

    Ranks of tied values are spread evenly over their places.
    """
    counts = np.zeros(max((len(results[c.key]) for c in configurations), default=0) + 1)
    for c in configurations:
        real = _real(c, metric)[0]
        simulated = np.asarray(_simulated(results, c, metric))
        if len(simulated) + 1 == len(counts) and np.isfinite(simulated).all():
            below, equal = int((simulated < real).sum()), int((simulated == real).sum())
            counts[below : below + equal + 1] += 1.0 / (equal + 1)
    return float(stats.chisquare(counts).pvalue) if counts.sum() > 0 else None


def part_b(configurations: Sequence[Configuration], results: Results, metric: str, spread: float) -> dict[str, Any]:
    """The figures of the single-run configurations for one metric."""
    per_route: dict[str, float | None] = {}
    bias_by_route: dict[str, float | None] = {}
    for route, group in _by_route(configurations).items():
        real = np.array([_real(c, metric)[0] for c in group])
        sim = np.array([np.nanmean(_simulated(results, c, metric)) for c in group])
        per_route[route] = spearman(real, sim)
        bias_by_route[route] = _finite(float(np.nanmean(sim) - real.mean()))
    biases = [np.nanmean(_simulated(results, c, metric)) - _real(c, metric)[0] for c in configurations]
    bias = float(np.nanmean(biases)) if biases else math.nan
    return {
        "spearman": _mean(per_route.values()),
        "spearman_by_route": per_route,
        "bias_sd": _finite(bias / spread if spread else math.nan),
        "bias": _finite(bias),
        "rank_p": rank_p(configurations, results, metric),
        "bias_by_route": bias_by_route,
    }


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def benchmark(
    folder: Path, routes: list[str], *, seeds: int, repeats: int, jobs: int, step: int = 1, seed: int = 0
) -> dict[str, Any]:
    """Run both parts and gather the figures. `step` > 1 takes only every step-th single-run configuration.

    Another `seed` gives other runs throughout: how much the figures differ is how much of them is luck.
    """
    began = time.perf_counter()
    folder = folder.resolve()
    grid = world_of(folder).grid
    read_a = list(repeated(folder, routes, grid))
    read_b = list(singles(folder, routes, grid))
    left_out = [entry for entry in read_a + read_b if isinstance(entry, LeftOut)]
    a = [entry for entry in read_a if isinstance(entry, Configuration)]
    every = [entry for entry in read_b if isinstance(entry, Configuration)]
    b = every[::step]
    single = simulate_all(folder, b, seeds, jobs, seed)
    frozen = sum(run["frozen"] > 0.0 for runs in single.values() for run in runs)
    kept = {key: [run for run in runs if not run["frozen"]] or runs for key, runs in single.items()}
    results = simulate_all(folder, a, repeats, jobs, seed) | kept
    spreads = {metric: spread_within_routes(every, metric) for metric in (*METRICS, "expected_jerk")}
    runs_b = [run for c in b for run in results[c.key]]
    return {
        "part_a": {m: part_a(a, results, m, spreads[m]) for m in spreads} if a and repeats > 1 else {},
        "part_b": {m: part_b(b, results, m, spreads[m]) for m in spreads} if b and seeds else {},
        "completed": {
            "published": _mean(float(done) for c in b for done in c.completed),
            "simulated": _mean(run["completed"] for run in runs_b),
        },
        "method_means_dto": _method_means(b, results),
        "routes": routes,
        "method_means_dto_se": _method_errors(b, results),
        "episodes": len(a) * repeats + len(b) * seeds,
        "wall_s": time.perf_counter() - began,
        "seed": seed,
        "seeds": seeds,
        "repeats": repeats,
        "scenarios": {"part_a": len(a), "part_b": len(b)},
        "left_out": {entry.key: entry.reason for entry in left_out},
        "left_out_simulated": frozen,
        "dropped_rows": "row 0 of every repeated scenario: the run that selected it",
    }


def _method_means(configurations: Sequence[Configuration], results: Results) -> dict[str, list[float | None]]:
    means: dict[str, list[float | None]] = {}
    for method in METHODS:
        mine = [c for c in configurations if c.method == method]
        if mine:
            real = _mean(_real(c, "dto")[0] for c in mine)
            means[method] = [real, _mean(_mean(_simulated(results, c, "dto")) for c in mine)]
    return means


def _method_errors(configurations: Sequence[Configuration], results: Results) -> dict[str, float | None]:
    """Standard errors of the differences of the method means: published runs are single, so these are not small."""
    errors: dict[str, float | None] = {}
    for method in METHODS:
        mine = [c for c in configurations if c.method == method]
        if len(mine) > 1:
            differences = [float(np.nanmean(_simulated(results, c, "dto"))) - _real(c, "dto")[0] for c in mine]
            errors[method] = _finite(float(np.std(differences, ddof=1)) / math.sqrt(len(mine)))
    return errors


def table(result: dict[str, Any]) -> str:
    """The figures as text."""

    def cell(value: object) -> str:
        return f"{value:9.3f}" if isinstance(value, float) else "        -"

    lines = [f"routes {', '.join(result['routes'])}; {result['episodes']} episodes in {result['wall_s']:.0f} s"]
    for part, columns in (
        (
            "part_a",
            ("spearman", "ceiling", "spearman_route_centred", "bias_sd", "sd_ratio", "a12_distance", "ks_share"),
        ),
        ("part_b", ("spearman", "bias_sd", "bias", "rank_p")),
    ):
        lines += [
            "",
            f"{part} ({result['scenarios'][part]} scenarios)",
            " " * 14 + " ".join(f"{c[:9]:>9}" for c in columns),
        ]
        for metric, figures in result[part].items():
            routes = " ".join(
                f"{r.removeprefix('route_')}:{cell(v).strip()}" for r, v in figures["spearman_by_route"].items()
            )
            biases = figures.get("bias_by_route", {})
            routes += (
                "  bias " + " ".join(f"{r.removeprefix('route_')}:{cell(v).strip()}" for r, v in biases.items())
                if biases
                else ""
            )
            lines.append(f"{metric:14}" + " ".join(cell(figures[c]) for c in columns) + f"   {routes}")
    lines += ["", f"completed: {result['completed']}"]
    lines += [
        f"dto of {m}: published {cell(p).strip()}, simulated {cell(s).strip()}, "
        f"standard error of the difference {cell(result['method_means_dto_se'].get(m)).strip()}"
        for m, (p, s) in result["method_means_dto"].items()
    ]
    lines += [f"left out {key}: {reason}" for key, reason in result["left_out"].items()]
    lines += [f"left out {result['left_out_simulated']} simulated single runs in which human 2 stayed where it began"]
    lines += [f"left out {result['dropped_rows']}"]
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark; with --quick, exit code 1 where a figure falls clearly below the last accepted one."""
    parser = argparse.ArgumentParser(description="Compare the embedded simulator with the published runs.")
    parser.add_argument("folder", type=Path, metavar="DIR")
    parser.add_argument("--routes", type=int, nargs="+", help="numbers of the routes; default: all in the folder")
    parser.add_argument("--seeds", type=int, default=4, help="runs per single-run configuration")
    parser.add_argument("--repeats", type=int, default=29, help="runs per repeated scenario")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0, help="another seed gives other runs throughout")
    parser.add_argument("--json", action="store_true")
    parser.add_argument(
        "--quick", action="store_true", help="every third scenario, few repeats, against accepted figures"
    )
    parser.add_argument("--accept", action="store_true", help="with --quick: keep the figures as the accepted ones")
    args = parser.parse_args(arguments)
    present = routes_in(args.folder)
    routes = present if args.routes is None else [f"route_{number}" for number in args.routes]
    if not routes or set(routes) - set(present):
        parser.error(
            f"{args.folder} holds the routes {', '.join(present) or 'none'}; asked for {', '.join(routes) or 'all'}"
        )
    try:
        map_folder(args.folder.resolve())
    except InputError as error:
        parser.error(str(error))
    if args.quick:
        result = benchmark(
            args.folder,
            routes,
            seeds=QUICK_SEEDS,
            repeats=QUICK_REPEATS,
            jobs=args.jobs,
            step=QUICK_STEP,
            seed=args.seed,
        )
    else:
        result = benchmark(args.folder, routes, seeds=args.seeds, repeats=args.repeats, jobs=args.jobs, seed=args.seed)
    print(json.dumps(result, indent=2, allow_nan=False) if args.json else table(result))
    return judge_quick(result, accept=args.accept) if args.quick else 0


def judge_quick(result: dict[str, Any], *, accept: bool) -> int:
    """Compare with the accepted figures of the same routes; margins of about two standard errors of a quick run."""
    watched = {
        f"{part}.{metric}": result[part][metric][figure]
        for part, figure in (("part_a", "spearman_route_centred"), ("part_b", "spearman"))
        for metric in ("dto", "por", "trg", "rpc", "chc", "pl")
    }
    if accept:
        ACCEPTED.write_text(json.dumps({"routes": result["routes"], "figures": watched}, indent=2) + "\n")
        return 0
    accepted = json.loads(ACCEPTED.read_text()) if ACCEPTED.is_file() else None
    if accepted is None or accepted["routes"] != result["routes"]:
        print("no accepted figures for these routes", file=sys.stderr)
        return 0
    failed = 0
    for name, before in accepted["figures"].items():
        now = watched[name]
        margin = 0.15 if name.startswith("part_a") else 0.08
        if before is not None and (now is None or now < before - margin):
            print(
                f"{name}: {now if now is None else round(now, 3)}, accepted {before:.3f} (margin {margin})",
                file=sys.stderr,
            )
            failed = 1
    return failed


if __name__ == "__main__":
    raise SystemExit(main())
