"""The reference pages of metrics and requirements, from their own tables."""

from __future__ import annotations

from rvsg.evaluation.metrics import METRICS
from rvsg.scenario.requirements import shipped_requirements

INTRODUCTION = """`rvsg metrics` prints the same list; `rvsg metrics --run FILE` measures a run. None (`null`) means
that a run holds no judgement, e.g. on people where there are none.

Ids without an ending read the trajectory, 20 Hz for our own runs. Ids ending in `_logged` read the rows (about 2 Hz,
wall clock) that the client of the published study would have written, by its formulas: they compare with published
numbers. Ids ending in `_hunav` give the HuNavSim evaluator's numbers, its defects included. An imported run has only
its logged rows, and every metric reads those. Counts of samples (`rpc`, `por`) grow with the sampling rate: compare
them among runs of one rate only, or use `contacts` and `contact_time`. `obstacle_distance` and the forces of
obstacles need the world, which a campaign gives; the space of groups needs people with the same `group`.

The forces of obstacles are computed from the surface of the nearest obstacle, with HuNavSim's default factor 10 for
everybody. The HuNavSim evaluator's own numbers for them have no `_hunav` variant: its force on the robot is always 0,
because the robot's obstacles are never filled in; its force on people needs the one obstacle point of each person,
which lies on the way to the origin of a Gazebo model's box, and neither a run nor a measured map holds those.

Besides these a set of scenarios has three diversities, in the tables: `sdd` = 1 - mean cosine similarity of the
descriptions' embeddings (all-MiniLM-L6-v2) over pairs; `htd` = mean over pairs of the mean Levenshtein distance between
task lists, human a of one against human b of the other; `ssd` = mean over pairs of the dynamic time warping distance of
the positions of robot and people at 2 Hz.
"""

USER_FILES = """A requirement names a metric or a [temporal formula](temporal-formulas.md), the direction that is worse,
and the limit beyond which a run violates it. These ship with RVSG; choose one by its name, `rvsg run --requirement
clearance`, or write your own file of the same layout and give `--requirement my.yaml#wide_berth`:

```yaml
wide_berth:
  title: Wide berth
  text: The robot stays at least 0.5 m away from every person.   # what the generator and the report read
  metric: min_distance        # or  formula: always (distance_to_person > 0.5)
  worse: smaller
  limit: 0.5                  # or  limit_share: 0.95, a share of the route's time limit
  unit: m                     # that of the metric; may be left out
  source: our risk assessment
```

The limit is in the unit of the metric ([metrics](metrics.md) lists them) and is never converted: another `unit` is
refused, a missing one is filled in, and `m/s3` is `m/s³`. `worse` must be the metric's own direction; a metric that
has none there (`neither`) takes both. `limit_share` is for metrics in seconds. A formula's robustness has the unit that
you give it.

The limits are choices to start from, each with its reason. Mistakes in a file are all told at once with their lines.
"""


def metrics_page() -> str:
    """Every metric with its unit, direction, formula and source, as Markdown."""
    lines = [INTRODUCTION, "| id | metric | unit | worse | formula | source |", "|---|---|---|---|---|---|"]
    for info in METRICS.values():
        cells = (f"`{info.id}`", info.title, info.unit, info.worse, info.formula, info.source)
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(lines) + "\n"


def requirements_page() -> str:
    """Every shipped requirement with its measure, limit and reason, as Markdown."""
    lines = [USER_FILES]
    for name, requirement in shipped_requirements().items():
        if requirement.formula is not None:
            measure = f"`{requirement.formula}`; violated below 0"
        else:
            beyond = "below" if requirement.worse == "smaller" else "above"
            unit = "" if requirement.unit.startswith("1") else f" {requirement.unit}"
            limit = f"{requirement.limit:g}{unit}" if requirement.limit is not None else "its limit"
            if requirement.limit_share is not None:
                limit = f"{requirement.limit_share:.0%} of the route's time limit"
            measure = f"`{requirement.metric}`; violated {beyond} {limit}"
        if requirement.measured_as:
            measure += f". Measured: {requirement.measured_as}"
        said = [requirement.text, f"{measure}.", requirement.note, requirement.source]
        lines.append("\n\n".join([f"## `{name}`: {requirement.title}", *filter(None, said)]) + "\n")
    return "\n".join(lines)
