"""Agreement of the built-in MPPI with Nav2's, run by run, where both draw the same noise.

    python benchmarks/mppi_noise.py KEPT [--draw 2]

MPPI keeps the noise of its samples from one period to the next and draws it anew when its optimiser is reset: at every
goal, and after a failure. Nav2 draws from one engine that begins alike at every start of a process: xtensor's default
engine, a Mersenne Twister with the seed of the C++ standard, through libstdc++'s normal distribution. So the k-th goal
after a start has the same noise on every machine with that library, and the built-in stack, which draws from the seed
of a run, can be given the noise that Nav2 had.

KEPT is a folder that `nav2_agreement.py --stacks nav2-mppi --keep KEPT` filled: the routes without people, driven in
the order of the routes and seeds by one process of Nav2. --draw is the draw of its first goal, counted from 0: two are
spent before, when the generator is made and when it is first reset. --started RUN ... names the runs (counted from 0)
before which Nav2 was started again, --skipped RUN ... those before which its optimiser was reset once more than at the
end of the goal, as a counter in its source tells. Runs in which the stack failed are left out. Prints JSON: times of
both, their correlation and differences.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
from numpy.typing import NDArray

ENGINE_SEED = 5489
"""std::mt19937::default_seed"""
Singles = NDArray[np.float32]


def main() -> int:
    """Simulate every kept run with the noise that Nav2 had, and print the comparison."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kept", type=Path)
    parser.add_argument("--draw", type=int, default=2)
    parser.add_argument("--started", type=int, nargs="*", default=[], metavar="RUN")
    parser.add_argument("--skipped", type=int, nargs="*", default=[], metavar="RUN")
    given = parser.parse_args()
    import rvsg
    from rvsg_ros2.nav2_file import new_nav2_params

    world = rvsg.load_world("warehouse")
    kept = {route.name: given.kept / f"{route.name}-empty-real-nav2-mppi.jsonl" for route in world.routes}
    driven = [
        (route, run) for route, path in kept.items() if path.is_file()
        for run in sorted(rvsg.load_runs(path), key=lambda run: run.seed)
    ]  # fmt: skip
    if not driven:
        print(f"{given.kept} holds no runs of Nav2 on the routes; see nav2_agreement.py --keep.", file=sys.stderr)
        return 2
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "nav2.yaml"
        file.write_text(new_nav2_params(stack="nav2-mppi", release="jazzy"))
        noise = Noise(given.draw)
        rows = []
        for number, (route, run) in enumerate(driven):
            if number in given.started:
                noise = Noise(given.draw)
            noise.skip(given.skipped.count(number))
            if not run.stack_fault:
                rows.append(row(route, run, str(file), noise))
    real, built_in = (np.array([each[key] for each in rows]) for key in ("nav2_s", "built_in_s"))
    over_all = {
        "runs": len(rows),
        "correlation_within_routes": within(rows),
        "mean_difference_s": round(float((built_in - real).mean()), 3),
        "median_absolute_difference_s": round(float(np.median(np.abs(built_in - real))), 3),
    }
    print(json.dumps({"over_all": over_all, "routes": by_route(rows), "runs": rows}, indent=1))
    return 0


def row(route: str, run: Any, stack: str, noise: Noise) -> dict[str, Any]:
    """Return the times of one run of Nav2 and of the built-in stack with the same seed and noise."""
    import rvsg

    before = noise.used
    with mock.patch("rvsg.simulation.stacks.mppi.start_again", noise.start_again):
        (own,) = rvsg.simulate(rvsg.scenario("warehouse", route, []), [run.seed], stack=stack)
    return {
        "route": route,
        "seed": run.seed,
        "draw": before,
        "resets": noise.used - before,
        "nav2_s": round(float(run.trajectory.t[-1]), 2),
        "built_in_s": round(float(own.trajectory.t[-1]), 2),
    }


def within(rows: list[dict[str, Any]]) -> float | None:
    """Return the correlation of the times of both, each less the mean of its route; None for too few runs."""
    routes = [each["route"] for each in rows]
    off = []
    for key in ("nav2_s", "built_in_s"):
        means = {name: np.mean([each[key] for each in rows if each["route"] == name]) for name in routes}
        off.append([each[key] - means[each["route"]] for each in rows])
    return round(float(np.corrcoef(off[0], off[1])[0, 1]), 3) if len(rows) > len(means) + 2 else None


def by_route(rows: list[dict[str, Any]]) -> dict[str, dict[str, float]]:
    """Return the mean times of each route, and how far runs of one route are apart."""
    found = {}
    for name in dict.fromkeys(each["route"] for each in rows):
        mine = [each for each in rows if each["route"] == name]
        found[name] = {
            f"{kind}_{key}": round(float(of([each[key] for each in mine])), 2)
            for key in ("nav2_s", "built_in_s")
            for kind, of in (("mean", np.mean), ("std", np.std))
        }
    return found


class Noise:
    """The draws of Nav2's engine, one after the other, as `mppi_work.start_again` takes them."""

    def __init__(self, first: int) -> None:
        self._normals = normals()
        self._left = first
        self.used = first
        """The number of the next draw."""

    def skip(self, draws: int) -> None:
        """Leave out some draws."""
        self._left += draws
        self.used += draws

    def start_again(self, work: Any, rng: np.random.Generator, numbers: Any) -> None:
        """Forget the control sequence and take the next noise of the engine: first that of v, then that of w."""
        work.control[:] = 0.0
        work.history[:] = 0.0
        steps, samples = work.noise_v.shape
        self._take(2 * steps * samples * self._left)
        self._left = 0
        for target, deviation in ((work.noise_v, numbers.options.vx_std), (work.noise_w, numbers.options.wz_std)):
            target[:] = np.float32(deviation) * self._take(steps * samples).reshape(samples, steps).T
        self.used += 1

    def _take(self, count: int) -> Singles:
        """Return the next normal numbers."""
        if not count:
            return np.empty(0, np.float32)
        parts, found = [], 0
        while found < count:
            part = next(self._normals)
            parts.append(part)
            found += part.size
        joined = np.concatenate(parts)
        self._normals = _before(joined[count:], self._normals)
        return joined[:count]


def normals() -> Iterator[Singles]:
    """Yield standard normal numbers as libstdc++ draws them with floats: Marsaglia's polar method, two at a time."""
    engine = np.random.RandomState(ENGINE_SEED)
    one = np.nextafter(np.float32(1.0), np.float32(0.0))
    while True:
        raw = engine.randint(0, 2**32, size=1 << 17, dtype=np.uint32).astype(np.float32)
        x, y = (2.0 * np.minimum(raw / np.float32(2.0**32), one) - 1.0).astype(np.float32).reshape(-1, 2).T
        square = x * x + y * y
        kept = (square <= 1.0) & (square > 0.0)
        x, y, square = x[kept], y[kept], square[kept]
        factor = np.sqrt(np.float32(-2.0) * np.log(square) / square)
        yield np.column_stack([y * factor, x * factor]).ravel().astype(np.float32)


def _before(first: Singles, others: Iterator[Singles]) -> Iterator[Singles]:
    if first.size:
        yield first
    yield from others


if __name__ == "__main__":
    sys.exit(main())
