"""Metrics: numbers that are read off one run by `measure`, those that ship and those of plug-ins.

An id that ends in `_hunav` gives the HuNavSim evaluator's number, its defects included. Metrics of the published study
as its client logged them (`_logged`) are plug-ins of `rvsg_study`.
"""

from __future__ import annotations

from collections.abc import Iterable

from rvsg.core.plugins import Registry
from rvsg.evaluation.metrics import hunav, performance, safety
from rvsg.evaluation.metrics.metric import Metric
from rvsg.evaluation.sampled import Sampled, sampled
from rvsg.simulation.run import Run
from rvsg.world.world import World

BUILT_IN = (*performance.METRICS, *safety.METRICS, *hunav.METRICS)

METRICS: Registry[Metric] = Registry("metric", Metric, {info.id: info for info in BUILT_IN})
"""Every metric by its id: those that ship, in the order they are listed, then those of plug-ins."""


def metric(name: str) -> Metric:
    """Return the metric of that id; UnknownName with the nearest id where there is none."""
    return METRICS.find(name, hint="`rvsg evaluate --metric all` lists them with their formulas.")


def find_metric(name: str | None) -> Metric | None:
    """Return the metric of that id, or None if there is none."""
    return METRICS.get(name) if name is not None else None


def measure(run: Run, names: Iterable[str] | None = None, *, world: World | None = None) -> dict[str, float | None]:
    """Return metrics of one run by id, None if the run holds no judgement.

    Args:
        names: Ids of the metrics; all where None. Raises UnknownName.
        world: Where the run took place; without it distances to obstacles are None.
    """
    seen = {"trajectory": sampled(run, world), "log": Sampled(run, run.log, world)}
    infos = list(METRICS.values()) if names is None else [metric(name) for name in names]
    return {info.id: info.value(seen[info.series]) for info in infos}
