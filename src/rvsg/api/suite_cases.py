"""Run one case of a suite: as many runs as its verdicts need, judged by each of its requirements."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from rvsg.api.filming import shot_of_run
from rvsg.campaign.attempt import Failure, Measurement
from rvsg.campaign.measuring import Measuring
from rvsg.campaign.parallel import Simulations
from rvsg.campaign.suite import Case, CaseResult, state_of
from rvsg.core.errors import SimulationError
from rvsg.evaluation.judge import next_repeats
from rvsg.evaluation.story import story_of
from rvsg.evaluation.verdict import Procedure
from rvsg.report.film import write_film
from rvsg.scenario.requirement import Requirement
from rvsg.simulation.protocol import Simulator
from rvsg.simulation.run import Run
from rvsg.world.world import World

Measured = tuple[list[Run], list[list[Measurement]]]
"""The runs of a case, and for each requirement their measurements."""


@dataclass(frozen=True)
class CaseWork:
    """A case, and what it is run with. `requirements` are in the order of the case's expectations."""

    case: Case
    world: World
    requirements: tuple[Requirement, ...]
    procedure: Procedure
    simulator: Simulator

    def results(
        self, *, runs: int | None, jobs: int, pictures: str | Path | None, on_message: Callable[[str], None]
    ) -> Iterator[CaseResult]:
        """Run the case and yield a result for each requirement.

        Args:
            runs: how many runs; by default as few as decide every verdict.
            pictures: a folder for a picture of the worst run.
        """
        made, measured = self._runs(runs, jobs, on_message)
        for k, row in enumerate(measured):
            yield self._result(k, made, row, None if pictures is None else Path(pictures))

    def _runs(self, runs: int | None, jobs: int, on_message: Callable[[str], None]) -> Measured:
        made: list[Run] = []
        measured: list[list[Measurement]] = [[] for _ in self.requirements]
        measuring = [self._measuring(each) for each in self.requirements]
        with Simulations(self.simulator, self.world, jobs=jobs, notify=on_message) as simulations:
            more = runs or self._more(measured)
            while more:
                seeds = range(len(made), len(made) + more)
                for pending in [simulations.submit(self.case.scenario, seed) for seed in seeds]:
                    found = pending.result()
                    if isinstance(found, Failure):
                        raise SimulationError(f"{self.case.name}, seed {found.seed}: {found.reason}")
                    made.append(found.unpack())
                    for row, each in zip(measured, measuring, strict=True):
                        row.append(each.measure(made[-1]))
                more = 0 if runs else self._more(measured)
        return made, measured

    def _measuring(self, requirement: Requirement) -> Measuring:
        return Measuring(requirement, self.world, procedure=self.procedure)

    def _more(self, measured: Sequence[Sequence[Measurement]]) -> int:
        """Return the most runs that any requirement asks for next; all of them where there is no limit."""
        wanted = []
        for requirement, row in zip(self.requirements, measured, strict=True):
            if requirement.threshold is None:
                wanted.append(self.procedure.max_runs - len(row))
            else:
                wanted.append(next_repeats(requirement, [m.objective for m in row], procedure=self.procedure))
        return max(wanted)

    def _result(self, index: int, made: Sequence[Run], row: Sequence[Measurement], pictures: Path | None) -> CaseResult:
        case, expectation, requirement = self.case, self.case.expectations[index], self.requirements[index]
        verdict = self._measuring(requirement).judge(row)
        worst = _worst(requirement, [m.objective for m in row])
        sentences = () if worst is None else story_of(made[worst], world=self.world, scenario=case.scenario)
        picture = None
        if pictures is not None and worst is not None and verdict.violations:
            picture = pictures / f"{case.name}-{requirement.name}.png"
            write_film(picture, shot_of_run(made[worst], row[worst], requirement, self.world, case.scenario))
        return CaseResult(
            case=case.name,
            title=case.title,
            requirement=expectation.requirement,
            expected=expectation.expected,
            reason=expectation.reason,
            state=state_of(expectation.expected, verdict, procedure=self.procedure),
            verdict=verdict,
            seeds=tuple(run.seed for run in made),
            violations=tuple(None if m.objective is None else requirement.violated_by(m.objective) for m in row),
            contacts=sum((m.values.get("contacts") or 0.0) > 0.0 for m in row),
            arrived=sum(run.completed for run in made),
            seconds=float(sum(run.trajectory.t[-1] for run in made)),
            story=tuple(sentence.text for sentence in sentences),
            worst_seed=None if worst is None else made[worst].seed,
            picture=None if picture is None else picture.as_posix(),
        )


def _worst(requirement: Requirement, objectives: Sequence[float | None]) -> int | None:
    known = [(requirement.badness(value), -k) for k, value in enumerate(objectives) if value is not None]
    return -max(known)[1] if known else None
