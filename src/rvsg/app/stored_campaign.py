"""A stored campaign: its plan, its attempts, its findings and its report page."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

from rvsg.app.commands import command_for, confirm_command, next_commands
from rvsg.app.folder import BEST, LEDGER, MATRIX, REPORT, reading, store_of
from rvsg.app.input_files import paths_of
from rvsg.app.record import CampaignRecord
from rvsg.app.saved_scenario import stack_file
from rvsg.app.settings import CampaignConfig, safe_name
from rvsg.core.errors import InputError, NothingJudged
from rvsg.core.files import write_whole
from rvsg.core.plugins import Spec
from rvsg.evaluation.verdict import counted
from rvsg.findings.findings import Finding
from rvsg.findings.ranking import best_attempt, search_attempts
from rvsg.generation.vlm.call_log import CALLS, CallLog
from rvsg.report.page import render_page
from rvsg.report.replay_data import traces_beside
from rvsg.report.result import CampaignAnswer, Result, is_complete
from rvsg.runs.attempt import Attempt, Plan
from rvsg.runs.ledger import Ledger
from rvsg.scenario.builder import FoundWith, scenario_json
from rvsg.scenario.requirement import Requirement, shipped_requirements
from rvsg.scenario.scenario import Mission
from rvsg.scenario.world_lookup import load_world, world_of
from rvsg.search.drive_alone import stored_alone
from rvsg.search.execution import runs_of
from rvsg.simulation.run import Run
from rvsg.simulation.simulators import by_content, described, stack_name, with_stack
from rvsg.world.routes import fitted
from rvsg.world.world import World


class StoredCampaign:
    """What a folder or a ledger file keeps of a campaign: its record, its attempts, and what they found."""

    def __init__(self, record: CampaignRecord, config: CampaignConfig, store: Path) -> None:
        self.record = record
        self.config = config
        """The settings, with every path where it is now."""
        self.source = store
        """The folder or the ledger file it is read from."""

    @property
    def folder(self) -> Path:
        """The folder of the campaign."""
        return self.config.folder

    @property
    def name(self) -> str:
        """The name of the campaign in its store."""
        return self.record.plan.name

    @property
    def plan(self) -> Plan:
        """What the campaign does."""
        return self.record.plan

    @property
    def requirement(self) -> Requirement:
        """The requirement, with its limit worked out for the route."""
        return self.record.plan.requirement

    @property
    def world(self) -> World:
        """The world of its mission; InputError if that world has changed since."""
        return world_of(self.plan.mission, near=(Path(self._world_found),))

    @property
    def shown_world(self) -> World:
        """The world to show it in: that of its mission, or as it is today if it has changed (`changes`)."""
        try:
            return self.world
        except InputError as error:
            if error.code != "world-changed":
                raise
            return load_world(self._world_found)

    @property
    def changes(self) -> str:
        """What its pages say where the world has changed since; empty where it has not."""
        try:
            self._check_route(self.world)
        except InputError as error:
            if error.code != "world-changed":
                raise
            return f"The world has changed since: verdicts are as stored, maps and places are today's. {error}"
        return ""

    def _check_route(self, world: World) -> None:
        if self.config.start_from is None:  # else the route is that of the scenario, such as a recorded drive
            check_same_route(self.plan.mission, world)

    @property
    def _world_found(self) -> str:
        typed, begun_in = str(self.record.config["world"]), self.record.provenance.begun_in
        return paths_of({"world": typed}, begun_in, self.folder).get(typed, typed)

    @property
    def simulator(self) -> Spec:
        """What makes its runs, with the stack under test, as `simulate` and `shrink` take it."""
        return with_stack(self.config.simulator_spec, self.config.stack_spec())

    @property
    def found_with(self) -> FoundWith:
        """What its scenarios are found with: the simulator as it was given, the stack by content, the requirement."""
        shipped = shipped_requirements().get(self.requirement.name, self.requirement)
        same = shipped.for_time_limit(self.plan.mission.route.time_limit_s) == self.requirement
        return FoundWith(
            simulator=by_content(self.config.simulator_spec, self.record.simulator.options),
            stack_file=stack_file(self.config.stack),
            requirement=shipped if same else self.requirement,
        )

    @property
    def command(self) -> str:
        """The command line that repeats the campaign."""
        return command_for(self.config)

    @property
    def finished(self) -> bool:
        """Return whether everything planned is done."""
        return is_complete(self.plan, self.attempts())

    @property
    def resumable(self) -> bool:
        """Return whether it lies where `run` finds it: not in a copied ledger file."""
        return self.source.is_dir() or self.source.name == LEDGER

    def attempts(self) -> list[Attempt]:
        """Return everything that was tried so far, in order."""
        with self.reading() as ledger:
            return list(ledger.attempts(self.name))

    @contextlib.contextmanager
    def result(self, *, world: World | str | Path | None = None) -> Iterator[Result]:
        """Open the store once, to be read, and yield what the campaign says so far.

        Ask the result for its parts within the `with` block; those that were asked for stay afterwards.

        Raises:
            InputError: `world` is another one, or its route has changed since the campaign was run.
        """
        place = self.shown_world if world is None else world_of(self.plan.mission, world)
        if world is not None:
            self._check_route(place)

        def commands(result: Result) -> dict[str, str]:
            return next_commands(self.config, result) if self.resumable else {}

        name, typed = stack_name(self.record.simulator), Path(self.config.stack or "").name
        with self.reading() as ledger:
            run_of = cache(ledger.run)
            try:
                yield Result(
                    self.plan,
                    list(ledger.attempts(self.name)),
                    place,
                    run_of,
                    alone=stored_alone(ledger, self.plan),
                    stack=f"{name} ({typed})" if typed and typed != Path(name).name else name,
                    commands=commands,
                    changes=self.changes,
                )
            finally:
                run_of.cache_clear()

    def candidates(self) -> list[Attempt]:
        """Return the configurations that violated in the search and are not confirmed yet, worst first."""
        with self.result() as result:
            return result.candidates

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Every confirmation with what it means, the worst first."""
        with self.result() as result:
            return result.findings

    @property
    def answer(self) -> CampaignAnswer:
        """What the campaign says, in finished text."""
        with self.result() as result:
            return result.answer

    def data(self, result: Result) -> dict[str, Any]:
        """Return a result as JSON-able data with commands, as `rvsg run --json` prints it."""
        data = result.data()
        for candidate in data["candidates"]:
            candidate["command"] = confirm_command(self.folder, candidate["attempt"])
        return data | {"out": str(self.folder), "report": str(self.folder / REPORT), "command": self.command}

    def runs(self) -> Iterator[Run]:
        """Return every run of the campaign, one at a time, in the order of the attempts."""
        with self.reading() as ledger:
            ids = [m.run_id for attempt in ledger.attempts(self.name) for m in attempt.measurements]
            for run_id in dict.fromkeys(ids):
                yield ledger.run(run_id)

    def check_judged(self, result: Result) -> None:
        """Check that something is known of the robot, before "no violation" is taken for an answer.

        Raises:
            NothingJudged: no proposal was a valid scenario, or the requirement has no value in any run (as where
                the stack under test failed in all of them).
        """
        if result.ranking:
            return
        searched = search_attempts(result.attempts)
        if not searched:
            raise NothingJudged(f"{self.folder}: nothing was judged: no attempt is stored. Run the campaign first.")
        if runs := runs_of(searched):
            first = result.run_of(next(m.run_id for attempt in searched for m in attempt.measurements))
            fault = f" ({first.stack_fault})" if first.stack_fault else ""
            why = (
                f"{self.requirement.name} has no value in any of {counted(runs, 'run')}; the first ended so: "
                f"{first.outcome.value}{fault}. Mend the stack under test or choose another requirement"
            )
            if runs == len(set().union(*(attempt.left_out(self.plan.realism) for attempt in searched))):
                why = (
                    f"somebody in each of {counted(runs, 'run')} does what fewer than {self.plan.realism:g} % of "
                    "recorded people did. Choose a smaller --realism"
                )
        else:
            problems = searched[0].proposal.problems
            reason = problems[0] if problems else "the generator gave no reason."
            why = (
                f"none of {counted(len(searched), 'proposal')} is a valid scenario; the first reason: {reason} "
                "Change what is asked for (--humans, --generator, --model or --route)"
            )
        raise NothingJudged(f"{self.folder}: nothing was judged: {why}, and run it with another --out.")

    def report(
        self,
        path: str | Path | None = None,
        *,
        world: World | str | Path | None = None,
        overview: bool = False,
        result: Result | None = None,
    ) -> Path:
        """Write the report page, and the worst scenario beside it; return the page's path.

        Args:
            overview: link to the overview of the folder that holds this one, which is linked anyway where it exists.
            result: what the campaign says, where it is known already.

        Raises:
            InputError: as `result`.
        """
        if result is None:
            with self.result(world=world) as result:
                return self.report(path, overview=overview, result=result)
        page, above = Path(path) if path is not None else self.page(), self.folder.parent
        linked = overview or (above / MATRIX).exists() or (store_of(above) is None and (above / REPORT).is_file())
        text = render_page(
            result,
            command=self.command,
            simulator=described(self.record.simulator),
            overview=f"../{REPORT}" if page.parent == self.folder and linked else "",
            traces=traces_beside(page, {m.run_id for attempt in result.attempts for m in attempt.measurements}),
            recording=self.recording,
            replayed=self.config.replay is not None,
        )
        write_whole(page, text)
        best = result.confirmed or best_attempt(result.attempts, self.requirement)
        if path is None and best is not None and best.proposal.scenario is not None:
            write_whole(self.folder / BEST, scenario_json(best.proposal.scenario, self.found_with))
        return page

    @property
    def recording(self) -> CallLog | None:
        """The calls of its model, where they are kept: in its folder, else in the folder it replays."""
        folders = [self.folder / "vlm"]
        if self.config.replay is not None:
            folders.append(Path(self.config.replay))
        return next((CallLog(place) for place in folders if (place / CALLS).is_file()), None)

    def page(self, *, several: bool = False) -> Path:
        """Return where its report is written; with a name of its own where the store holds several campaigns."""
        return self.folder / (f"report-{safe_name(self.name)}.html" if several else REPORT)

    def reading(self) -> contextlib.AbstractContextManager[Ledger]:
        """Open its store to be read; closed at the end of the `with` block."""
        return reading(self.source)


def check_same_route(mission: Mission, world: World) -> None:
    """Refuse a world whose route, fitted to the mission's robot, is not that of the mission any more."""
    route = mission.route
    same = next((candidate for candidate in world.routes if candidate.name == route.name), None)
    if same is not None and not isinstance(mission.robot, str):
        same = fitted(same, mission.robot, world)[0]
    if same == route:
        return
    raise InputError(
        f"{world.name}: {route.name} has changed since the campaign was run. Run the campaign again with another "
        "--out, or give a copy of the world it was run in with --world.",
        code="world-changed",
    )
