"""A stored campaign: its plan, its attempts, its findings and its report page."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from rvsg.app.commands import command_for, confirm_command, next_commands
from rvsg.app.folder import BEST, LEDGER, MATRIX, REPORT, reading, store_of
from rvsg.app.input_files import paths_of
from rvsg.app.record import CampaignRecord
from rvsg.app.settings import CampaignConfig, safe_name
from rvsg.campaign.attempt import Attempt, Plan
from rvsg.campaign.drive_alone import stored_alone
from rvsg.campaign.execution import runs_of
from rvsg.campaign.feedback import MapCell, failure_map
from rvsg.campaign.findings import DistinctFailure, Finding, distinct_failures, findings, worst_confirmation
from rvsg.campaign.ledger import Ledger
from rvsg.campaign.ranking import Front, best_attempt, candidates, front_of, search_attempts, standing
from rvsg.core.errors import InputError, NothingJudged
from rvsg.core.files import write_whole
from rvsg.core.plugins import Spec
from rvsg.evaluation.verdict import Verdict, counted
from rvsg.generation.vlm.recording import CALLS, Recording
from rvsg.report.answer import Answer, answer_of
from rvsg.report.page import render_page
from rvsg.report.replay_data import traces_beside
from rvsg.report.summary import Summary, summarise
from rvsg.scenario.builder import scenario_json
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Mission
from rvsg.scenario.world_lookup import load_world, world_of
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
    def found_with(self) -> Spec:
        """What its scenarios are found with: the simulator as it was given, and the stack by content and version."""
        return by_content(self.config.simulator_spec, self.record.simulator.options)

    @property
    def command(self) -> str:
        """The command line that repeats the campaign."""
        return command_for(self.config)

    @property
    def finished(self) -> bool:
        """Return whether everything planned is done."""
        return self.summary().complete

    @property
    def resumable(self) -> bool:
        """Return whether it lies where `run` finds it: not in a copied ledger file."""
        return self.source.is_dir() or self.source.name == LEDGER

    def attempts(self) -> list[Attempt]:
        """Return everything that was tried so far, in order."""
        with self.reading() as ledger:
            return list(ledger.attempts(self.name))

    def candidates(self) -> list[Attempt]:
        """Return the configurations that violated in the search and are not confirmed yet, worst first."""
        attempts = self.attempts()
        confirmed = {a.scenario_id for a in attempts if a.purpose == "confirmation"}
        violating = [a for a in candidates(attempts, self.requirement) if standing(a, self.requirement)[0] > 0.0]
        return [a for a in violating if a.scenario_id not in confirmed]

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Every confirmation with what it means, the worst first."""
        with self.reading() as ledger:
            attempts = list(ledger.attempts(self.name))
            return findings(self.plan, attempts, run_of=ledger.run, world=self.shown_world)

    @property
    def distinct_failures(self) -> tuple[DistinctFailure, ...]:
        """The confirmed violations, grouped by where and how the robot fails; the worst group first."""
        return distinct_failures(self.findings)

    @property
    def failure_map(self) -> tuple[MapCell, ...]:
        """The worst configuration of the search for every kind of encounter, the worst first."""
        with self.reading() as ledger:
            attempts = list(ledger.attempts(self.name))
            return failure_map(attempts, self.requirement, run_of=ledger.run, world=self.shown_world)

    @property
    def front(self) -> Front | None:
        """The Pareto front of its requirements and its hypervolume; None if it has only one requirement."""
        return front_of(self.plan, self.attempts()) if self.plan.also else None

    def result(self) -> dict[str, Any]:
        """Return what was found as JSON-able data, as `rvsg run --json` prints it."""
        confirmed = self.findings
        found = {"confirmed": [finding.model_dump(mode="json") for finding in confirmed]}
        found["distinct_failures"] = [each.model_dump(mode="json") for each in distinct_failures(confirmed)]
        found["candidates"] = [
            {"attempt": a.index, "scenario": a.brief.scenario_index, "command": confirm_command(self.folder, a.index)}
            for a in self.candidates()
        ]
        found["failure_map"] = [cell.model_dump(mode="json") for cell in self.failure_map]
        front = self.front
        answer = {"answer": self.answer.model_dump(mode="json")}
        several = {"front": front.model_dump(mode="json") if front is not None else None}
        kept = {"out": str(self.folder), "report": str(self.folder / REPORT), "command": self.command}
        return self.summary().model_dump(mode="json", exclude={"confirmed"}) | found | answer | several | kept

    @property
    def answer(self) -> Answer:
        """What the campaign says, in finished text; every page and the terminal show it."""
        with self.reading() as ledger:
            attempts, run_of = list(ledger.attempts(self.name)), cache(ledger.run)
            found = findings(self.plan, attempts, run_of=run_of, world=self.shown_world)
            known = summarise(self.plan, attempts)
            return answer_of(
                self.plan, attempts, known, found, world=self.shown_world, run_of=run_of, **self._beside(ledger, known)
            )

    def _beside(self, ledger: Ledger, known: Summary) -> dict[str, Any]:
        """Return what the answer tells besides the attempts."""
        commands = next_commands(self.config, known) if self.resumable else {}
        name, given = stack_name(self.record.simulator), Path(self.config.stack or "").name
        stack = f"{name} ({given})" if given and given != Path(name).name else name
        alone = stored_alone(ledger, self.plan)
        return {"alone": alone, "stack": stack, "commands": commands, "changes": self.changes}

    def runs(self) -> Iterator[Run]:
        """Return every run of the campaign, one at a time, in the order of the attempts."""
        with self.reading() as ledger:
            ids = [m.run_id for attempt in ledger.attempts(self.name) for m in attempt.measurements]
            for run_id in dict.fromkeys(ids):
                yield ledger.run(run_id)

    def summary(self, attempts: Sequence[Attempt] | None = None) -> Summary:
        """Return what was found so far as plain data, or what some of its attempts found."""
        return summarise(self.plan, self.attempts() if attempts is None else attempts)

    def check_judged(self) -> None:
        """Check that something is known of the robot, before "no violation" is taken for an answer.

        Raises:
            NothingJudged: no proposal was a valid scenario, or the requirement has no value in any run (as where
                the stack under test failed in all of them).
        """
        searched = search_attempts(self.attempts())
        if self.summary(searched).ranking:
            return
        if not searched:
            raise NothingJudged(f"{self.folder}: nothing was judged: no attempt is stored. Run the campaign first.")
        if runs := runs_of(searched):
            first = next(self.runs())
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

    @property
    def verdict(self) -> Verdict | None:
        """The verdict of the confirmation that says most against the robot; None before any."""
        confirmed = self.summary().confirmed
        return confirmed.verdict if confirmed else None

    def report(
        self, path: str | Path | None = None, *, world: World | str | Path | None = None, overview: bool = False
    ) -> Path:
        """Write the report page, and the worst scenario beside it; return the page's path.

        Args:
            overview: link to the overview of the folder that holds this one, which is linked anyway where it exists.

        Raises:
            InputError: `world` is another one, or its route has changed since the campaign was run.
        """
        page = Path(path) if path is not None else self.page()
        place = self.shown_world if world is None else world_of(self.plan.mission, world)
        if world is not None:
            self._check_route(place)
        with self.reading() as ledger:
            attempts = list(ledger.attempts(self.name))
            above = self.folder.parent
            known = (above / MATRIX).exists() or (store_of(above) is None and (above / REPORT).is_file())
            text = render_page(
                self.plan,
                attempts,
                world=place,
                run_of=ledger.run,
                command=self.command,
                simulator=described(self.record.simulator),
                **self._beside(ledger, summarise(self.plan, attempts)),
                overview=f"../{REPORT}" if page.parent == self.folder and (overview or known) else "",
                traces=traces_beside(page, {m.run_id for attempt in attempts for m in attempt.measurements}),
                recording=self.recording,
                replayed=self.config.replay is not None,
            )
        write_whole(page, text)
        best = self._worst(attempts)
        if path is None and best is not None and best.proposal.scenario is not None:
            write_whole(self.folder / BEST, scenario_json(best.proposal.scenario, self.found_with))
        return page

    def _worst(self, attempts: Sequence[Attempt]) -> Attempt | None:
        """Return the most severe confirmation; without one the candidate that ranks first."""
        return worst_confirmation(attempts, self.requirement) or best_attempt(attempts, self.requirement)

    @property
    def recording(self) -> Recording | None:
        """The calls of its model, where they are kept: in its folder, else in the folder it replays."""
        folders = [self.folder / "vlm"]
        if self.config.replay is not None:
            folders.append(Path(self.config.replay))
        return next((Recording(each) for each in folders if (each / CALLS).is_file()), None)

    def page(self, *, several: bool = False) -> Path:
        """Return where its report is written; with a name of its own where the store holds several campaigns."""
        return self.folder / (f"report-{safe_name(self.name)}.html" if several else REPORT)

    def reading(self) -> contextlib.AbstractContextManager[Ledger]:
        """Open its store to be read; closed at the end of the `with` block."""
        return reading(self.source)


def check_same_route(mission: Mission, world: World) -> None:
    """Refuse a world whose route, fitted to the mission's robot, is not that of the mission any more."""
    route = mission.route
    same = next((each for each in world.routes if each.name == route.name), None)
    if same is not None and not isinstance(mission.robot, str):
        same = fitted(same, mission.robot, world)[0]
    if same == route:
        return
    raise InputError(
        f"{world.name}: {route.name} has changed since the campaign was run. Run the campaign again with another "
        "--out, or give a copy of the world it was run in with --world.",
        code="world-changed",
    )
