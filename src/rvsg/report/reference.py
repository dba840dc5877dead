"""The reference pages of metrics and requirements, from their own tables."""

from __future__ import annotations

from rvsg.evaluation.metrics.registry import METRICS
from rvsg.scenario.requirement import shipped_requirements

INTRODUCTION = """`rvsg evaluate --metric all` prints the same list; with FILE it measures a run. A metric is None
(`null`) where a run cannot be judged by it, for example a distance to people where there are none.

Ids without an ending read the trajectory, which RVSG's own runs record at 20 Hz. Ids ending in `_logged` read the rows
(about 2 Hz, wall clock) that the client of the published study would have written, by its formulas, and compare with
published numbers. Ids ending in `_hunav` give the HuNavSim evaluator's numbers, including its defects. An imported run
has only its logged rows, and every metric reads those. Counts of samples (`rpc`, `por`) grow with the sampling rate:
compare them only between runs of one rate, or use `contacts` and `contact_time`. `obstacle_distance` and the forces of
obstacles need the world, which a campaign provides. The space of groups needs people with the same `group`.

Contacts, gaps and distances to people use the robot's outline where the simulator keeps bodies apart, and the contacts
it recorded. The metrics of the study and of HuNavSim use discs, as those do.

The forces of obstacles come from the surface of the nearest obstacle, with HuNavSim's default factor 10 for everybody.
They have no `_hunav` variant: the evaluator's force on the robot is always 0, because it never fills in the robot's
obstacles. Its force on people needs one obstacle point of each person, on the way to the origin of a Gazebo model's
box, which neither a run nor a measured map holds.

A set of scenarios also has three diversities, in the tables: `sdd` = 1 - mean cosine similarity of the descriptions'
embeddings (all-MiniLM-L6-v2) over pairs; `htd` = mean over pairs of the mean Levenshtein distance between task lists,
human a of one against human b of the other; `ssd` = mean over pairs of the dynamic time warping distance of the
positions of robot and people at 2 Hz.

## Add a metric or a signal

A metric declares how it is computed and what it is about. The aim tells the offline generator what people should do;
the signal `shown` is the series that feedback and report show; bounds and censoring keep the statistics honest.

```python
from rvsg.evaluation.metrics import Metric
from rvsg.evaluation.sampled import Sampled
from rvsg.scenario.requirement import Aim


def reversing(s: Sampled) -> float | None:
    \"\"\"Seconds in which the robot drives backwards.\"\"\"
    return float(s.dt[s.series.v[1:] < -0.01].sum()) if len(s) > 1 else None


REVERSING = Metric(
    id="reversing",
    title="Time in reverse",
    unit="s",
    worse="larger",
    source="our fleet",
    of=reversing,
    aim=Aim.DISTURB,
    shown="forward_speed",
    moved_by="People who step in front of the robot.",
    most="time_limit",
)
```

Register it in the `pyproject.toml` of your package. A requirement then names it like any other metric:

```toml
[project.entry-points."rvsg.metrics"]
reversing = "my_package:REVERSING"
```

The curve in the replay measures the beginnings of a run one by one. Where that is slow, give `so_far=`: a function from
the sampled run to one value for each sample, as if the run ended there.

An entry point may also give a sequence of metrics. Signals are `rvsg.evaluation.signals.RunSignal` records in the group
`rvsg.signals`. An id that is taken is refused.

## List of metrics
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
refused, a missing one is filled in, and `m/s3` is `m/s³`. `worse` must be the direction of the metric; a metric with
`neither` takes both. `limit_share` is for metrics in seconds. A formula's robustness has the unit that you give it.

The limits are starting points, each with its reason. RVSG reports all mistakes in a file at once, with their lines. A
metric or signal that is not installed blocks only the requirement that uses it.
"""


def metrics_page() -> str:
    """Return every metric with unit, direction, formula, source and what makes it worse, as Markdown."""
    heads = ("id", "metric", "unit", "worse", "formula", "made worse by", "source")
    lines = [INTRODUCTION, "| " + " | ".join(heads) + " |", "|" + "---|" * len(heads)]
    for info in METRICS.values():
        cells = (f"`{info.id}`", info.title, info.unit, info.worse, info.formula, info.moved_by, info.source)
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(lines) + "\n"


def requirements_page() -> str:
    """Return every shipped requirement with its measure, limit and reason, as Markdown."""
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
