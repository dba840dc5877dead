"""Suites of scenarios: a folder in your repository, run against every version of the robot."""

from __future__ import annotations

import os
import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, suppress
from itertools import groupby
from pathlib import Path

from rvsg.app.campaign import Campaign
from rvsg.app.saved_scenario import stack_file
from rvsg.core import permission
from rvsg.core.errors import InputError
from rvsg.core.plugins import Spec, ignore
from rvsg.evaluation.verdict import counted
from rvsg.report.answer_row import AnswerRow
from rvsg.report.film import shot_of_run, write_film
from rvsg.robots.robot import Robot
from rvsg.runs.attempt import Measurement
from rvsg.scenario.builder import as_robot
from rvsg.scenario.requirement import Requirement
from rvsg.simulation.run import Run
from rvsg.simulation.simulators import Simulator, as_found, by_content, simulator_of, stack_in_words
from rvsg.simulation.stacks.stack_choice import StackChoice, StackLike
from rvsg.suites.suite import CaseResult, SuiteResult
from rvsg.suites.suite_folder import SuiteCase, SuiteFolder, requirement_of, run_cases


class Suite(SuiteFolder):
    """A suite in a folder that can be run. Make one with `Suite.create` or `Suite.open`."""

    def run(
        self,
        *,
        simulator: str | Spec | Simulator | None = None,
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
            simulator: what runs the scenarios: the version under test. By default each case runs with the simulator,
                options and stack that it was found with; options that are given replace those of the case.
            stack: the navigation stack under test. Like a simulator, it stays open where it is given as an instance.
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
            requirement: Requirement,
            worst: Run,
            runs: Sequence[tuple[Run, Measurement]],
        ) -> CaseResult:
            """Add a picture of the worst run, where one is asked for and a run violates."""
            if pictures is None or not result.verdict.violations:
                return result
            picture = Path(pictures) / f"{result.case}-{requirement.name}.png"
            measured = next(measured for run, measured in runs if run is worst)
            scenario = tested.case.scenario
            write_film(picture, shot_of_run(worst, measured, requirement, tested.world, scenario))
            return result.replace(picture=picture.as_posix())

        other: Robot | str | None = None
        for given, alike in groupby(chosen, lambda case: as_found(case.simulator, simulator, stack)):
            cases = [self.tested(case.name) for case in alike]
            asked = given if isinstance(given, Spec) and _is_data(stack) else None
            named = permission.only({"simulator": simulator, "stack": stack})
            with named, simulator_of(given, stack, on_message=on_message) as ready:
                used = by_content(asked or Spec(ready.name), ready.options)
                tested = stack_in_words(used)
                if stack is None:
                    tested += " as the cases keep it"
                elif file := stack_file(stack):
                    tested = f"{os.path.relpath(file)}, {tested}"
                on_message(f"{tested}, {ready.name}: {counted(len(cases), 'case')}.")
                for text in _changed_since(cases, used, self.folder, tests_file=stack is not None):
                    on_message(text)
                other = None if robot is None else as_robot(robot, ready.robots)
                driven = [case if other is None else case.driven_by(other) for case in cases]
                for result in run_cases(driven, ready, runs=runs, jobs=jobs, finish=illustrated, on_message=on_message):
                    results.append(result.replace(simulator=asked and used, stack=stack_in_words(used)))
                    on_result(results[-1])
        return SuiteResult(
            suite=self.head.title,
            version=version or "; ".join(dict.fromkeys(result.stack for result in results)),
            simulator=ready.name,
            options=dict(ready.options),
            robot=other,
            cases=tuple(results),
        )


def add_failures(suite: Suite, campaign: Campaign, rows: Sequence[AnswerRow]) -> Suite:
    """Add failures of a campaign as cases, those that only touch a person under `any_contact`; return the new suite.

    Args:
        rows: failures of its answer.
    """
    scenarios = {attempt.index: attempt.proposal.scenario for attempt in campaign.attempts()}
    for row in rows:
        scenario = scenarios[row.attempt]
        assert scenario is not None, "a confirmed scenario is valid"
        judged = None if row.violated == "yes" else "any_contact"
        suite = suite.add(scenario, judged, title=row.name, world=campaign.world, found=campaign.found_with)
    return suite


def _is_data(stack: StackLike | None) -> bool:
    return isinstance(stack, str | Path | Spec | Mapping | None)


def _changed_since(cases: Sequence[SuiteCase], used: Spec, folder: Path, *, tests_file: bool) -> Iterator[str]:
    """Yield what is another version today than the cases were found with."""
    for tested in cases:
        stored = tested.case.simulator
        if stored is not None and stack_in_words(stored) != stack_in_words(used):
            yield f"{tested.case.name} was found with {stack_in_words(stored)}; this run tests {stack_in_words(used)}."
        for expectation in tested.case.expectations:
            with suppress(InputError):  # a file that is gone: the case holds the definition
                if expectation.definition not in (None, requirement_of(expectation.replace(definition=None), folder)):
                    yield (
                        f"{tested.case.name}: {expectation.requirement} is defined otherwise today. The case keeps its "
                        "definition; to take the new one, add the case again with `rvsg suite add`."
                    )
    files = dict.fromkeys(
        folder / tested_case.case.stack_file for tested_case in cases if tested_case.case.stack_file and not tests_file
    )
    for file in filter(Path.is_file, files):
        with closing(StackChoice.of(file)) as choice:
            today = stack_in_words(Spec(used.name, {"stack": choice.record.model_dump(mode="json")}))
        if today != stack_in_words(used):
            yield (
                f"{file.name} is {today} today, and this run tests what the cases keep. To test the file: "
                f"--stack {shlex.quote(os.path.relpath(file))}"
            )
