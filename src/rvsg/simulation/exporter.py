"""The protocol of export formats: scenarios and runs as files of other tools."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal

from rvsg.scenario.scenario import Scenario
from rvsg.simulation.run import Run
from rvsg.world.world import World

if TYPE_CHECKING:
    from rvsg.simulation.embedded.trace import Trace


@dataclass(frozen=True, kw_only=True)
class Exportable:
    """What is exported: a scenario with its world, and the runs of it where any are given or made."""

    scenario: Scenario | None = None
    world: World | None = None
    runs: tuple[Run, ...] = ()
    trace: Trace | None = None


class Exporter:
    """A format of another tool, registered under `rvsg.exporters` by the name of the format."""

    takes: ClassVar[Literal["scenario", "runs", "either", "nothing"]] = "scenario"
    """What the format holds. For a format of runs, a scenario is simulated first."""

    def check(self) -> None:
        """Raise InputError where a library that the format needs is not installed."""

    def write(self, source: Exportable, path: Path) -> tuple[str, ...]:
        """Write the file and return what it cannot hold, a sentence each; raise InputError where the source is none."""
        raise NotImplementedError
