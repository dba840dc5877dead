"""Suites of scenarios: a folder in your repository, run against every version of the robot."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from rvsg.campaign.attempt import Measurement
from rvsg.campaign.runner import Evaluator
from rvsg.campaign.suite import CaseResult, SuiteResult
from rvsg.campaign.suite_folder import SuiteCase, SuiteFolder, run_cases
from rvsg.core.plugins import Spec, ignore
from rvsg.report.film import shot_of_run, write_film
from rvsg.robots.robot import Robot
from rvsg.scenario.builder import as_robot
from rvsg.simulation.run import Run
from rvsg.simulation.simulators import Simulator, simulator_of, with_stack
from rvsg.simulation.stacks.stack_choice import StackLike


class Suite(SuiteFolder):
    """A suite in a folder that can be run. Make one with `Suite.create` or `Suite.open`."""

    def run(
        self,
        *,
        simulator: str | Spec | Simulator = "embedded",
        stack: StackLike | None = None,
        version: str = "",
        jobs: int = 1,
        runs: int | None = None,
        only: Sequence[str] = (),
        robot: Robot | str | Path | None = None,
        pictures: str | Path | None = None,
        on_result: Callable[[CaseResult], None] = ignore,
        on_message: Callable[[str], None] = ignore,
    ) -> SuiteResult:
        """Run the suite.

        Every version meets the same seeds, 0, 1, ..., so that versions can be compared run by run.

        Args:
            simulator: what runs the scenarios: the version under test.
            stack: the navigation stack under test, by default the simulator's own. Like a simulator, it stays open
                where it is given as an instance.
            version: a label for the results.
            jobs: worker processes; the results are the same.
            runs: runs of every case; by default as few as decide each verdict. Give a number to compare versions.
            only: names of cases; by default all.
            robot: drives every case instead of the robot of its scenario: a record, the name of a shipped robot or a
                robot file.
            pictures: a folder for pictures of the worst run of each case that has a violating run.
            on_result: called with the result of each case and requirement.

        Raises:
            UnknownName: there is no such case, or the simulator does not know a robot.
            FileError: the suite has no case.
            SimulationError: a run could not be made.
        """
        chosen = self.chosen(only)
        results = []

        def illustrated(
            result: CaseResult,
            tested: SuiteCase,
            measuring: Evaluator,
            worst: Run,
            runs: Sequence[tuple[Run, Measurement]],
        ) -> CaseResult:
            """Add a picture of the worst run, where one is asked for and a run violates."""
            if pictures is None or not result.verdict.violations:
                return result
            picture = Path(pictures) / f"{result.case}-{measuring.requirement.name}.png"
            measured = next(measured for run, measured in runs if run is worst)
            scenario = tested.case.scenario
            write_film(picture, shot_of_run(worst, measured, measuring.requirement, tested.world, scenario))
            return result.replace(picture=picture.as_posix())

        with simulator_of(simulator, stack, on_message=on_message) as made:
            other = None if robot is None else as_robot(robot, made.robots)
            cases = [self.tested(case.name) for case in chosen]
            driven = [each if other is None else each.driven_by(other) for each in cases]
            for result in run_cases(
                driven, made, self.head.judging, runs=runs, jobs=jobs, finish=illustrated, on_message=on_message
            ):
                results.append(result)
                on_result(result)
        return SuiteResult(
            suite=self.head.title,
            version=version or str(made.name),
            simulator=made.name,
            options=dict(made.options),
            asked=_asked(simulator, stack),
            robot=other,
            cases=tuple(results),
        )


def _asked(simulator: str | Spec | Simulator, stack: StackLike | None) -> Spec | None:
    """Return what was asked for as data, or None if an object was given."""
    if not isinstance(simulator, str | Spec) or not isinstance(stack, str | Path | Spec | Mapping | None):
        return None
    return with_stack(simulator, stack)
