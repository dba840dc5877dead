"""Import of published results, or any in the same layout, into a store as records of campaigns.

Campaigns are named by their folder (`distance/route_1`). The runs keep the logged metrics in `details["logged"]`
beside ours, which are computed from the logs. A repeated run of a best or worst scenario is a confirmation; the run
by which the scenario was selected is found by the content of its log and marked `selection`.
"""

from __future__ import annotations

import csv
import hashlib
import io
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path

from rvsg.core.errors import FileError, UnknownName
from rvsg.core.files import write_whole
from rvsg.core.inputs import read_bytes
from rvsg.core.records import content_id
from rvsg.evaluation.metrics import measure
from rvsg.evaluation.verdict import judge
from rvsg.generation.generator import Proposal
from rvsg.runs.attempt import Attempt, Failure, Measurement
from rvsg.runs.ledger import Ledger
from rvsg.scenario.brief import Brief
from rvsg.scenario.rules import Finding
from rvsg.scenario.scenario import Mission, Scenario
from rvsg.simulation.archive import PackedRun
from rvsg.simulation.run import Outcome, Run
from rvsg.world.world import Route, World
from rvsg_study.study_folder import (
    EXACT,
    LOGGED,
    REQUIREMENTS,
    TOLERANCE,
    Batch,
    ImportFinding,
    Kind,
    ReadPeople,
    batches,
    numbered,
    read_description,
    read_logged,
    read_people,
)
from rvsg_study.study_format import LARGEST_LOG, Unreadable, read_log, read_table, shown

SIMULATOR = "imported"
STRATEGY = {"rvsg": "study", "unguided": "unguided", "random": "random", "best": "study", "worst": "study"}
HUMAN_RADIUS_M = 0.4
COLUMNS = ("file", "kind", "message")
"""Columns of the list of findings."""


@dataclass
class Imported:
    """The result of an import: counts, and the defects found."""

    campaigns: int = 0
    attempts: int = 0
    runs: int = 0
    refused: int = 0
    compared: int = 0
    """Runs whose metrics were computed again and compared with the logged ones."""
    differing: int = 0
    """Logged metrics that the logs do not give."""
    findings: list[ImportFinding] = field(default_factory=list)


def import_study(root: Path, ledger: Ledger, world: World, tell: Callable[[str], None] = lambda _: None) -> Imported:
    """Read everything under `root` into the ledger; FileError if nothing has the layout.

    A campaign that the ledger already holds is skipped, so that an import can be repeated or added to.
    """
    done = Imported()
    groups = find_campaigns(root, done.findings)
    known = set(ledger.campaigns())
    importer = _Importer(root, ledger, world, done)
    # Searches first: a confirmation looks among them for the run by which it was selected.
    for name, group in sorted(groups.items(), key=lambda item: item[1][0].repeats):
        if name in known:
            tell(f"{name}: already in the store, left as it is")
            continue
        tell(name)
        importer.campaign(name, group)
    return done


def find_campaigns(root: Path, findings: list[ImportFinding]) -> dict[str, list[Batch]]:
    """Return the scenarios under `root` by campaign; FileError if nothing has the layout."""
    if not root.is_dir():
        raise FileError(root, "this is not a folder; expected the root of the study's results")
    groups: dict[str, list[Batch]] = {}
    for batch in batches(root, findings):
        groups.setdefault(shown(batch.folder.parent, root), []).append(batch)
    if not groups:
        raise FileError(
            root, "holds no folder like distance/route_1/0 or no_req/route_1/0: nothing to import", code="study-layout"
        )
    return groups


@dataclass
class _Importer:
    root: Path
    ledger: Ledger
    world: World
    done: Imported
    searched: dict[str, str] = field(default_factory=dict)

    def campaign(self, name: str, group: list[Batch]) -> None:
        """Import the scenarios of one requirement and route."""
        try:
            route = self.world.route(group[0].route)
        except UnknownName as error:
            self._find(group[0].folder.parent, "layout", f"left out: {error}")
            return
        settings = {"imported": True, "method": group[0].method, "folder": name, "world": self.world.id}
        self.ledger.begin(name, settings)
        self.done.campaigns += 1
        index = 0
        for batch in group:
            for attempt, runs in self._attempts(name, batch, route, index):
                self.ledger.append(attempt, [PackedRun.of(run) for run in runs])
                index = attempt.index + 1
                self.done.attempts += 1
                self.done.runs += len(runs)

    def _attempts(self, name: str, batch: Batch, route: Route, index: int) -> Iterable[tuple[Attempt, list[Run]]]:
        description, problem = read_description(batch.folder)
        if problem:
            self._find(batch.folder, "scenario", problem)
        logged, completed, wrong = read_logged(batch.folder)
        for message in wrong:
            self._find(batch.folder / "log.csv", "metrics", message)
        requirement = REQUIREMENTS[batch.requirement] if batch.requirement else None
        files = numbered(batch.folder, "configuration")
        logs = numbered(batch.folder, "log")
        if batch.repeats:
            groups = {0: (next(iter(files.values()), None), logs)}
        else:
            groups = {k: (files.get(k), {k: logs[k]} if k in logs else {}) for k in sorted({*files, *logs})}
        for offset, (number, (file, own_logs)) in enumerate(groups.items()):
            proposal = self._proposal(batch, file, number, description, route)
            scenario = proposal.scenario
            scenario_id = scenario.id if scenario else content_id("unread", f"{name}/{batch.scenario}/{number}")
            runs, failures = [], []
            for k, log in own_logs.items():
                run = self._run(log, k, scenario_id, route, logged.get(k), completed.get(k))
                if isinstance(run, Run):
                    runs.append(run)
                else:
                    failures.append(run)
            if not own_logs:
                self._find(batch.folder, "log", f"there is no log_{number}.csv: configuration {number} was not run")
            if batch.repeats:
                chosen = [run.id for run in runs if str(run.details["sha256"]) in self.searched]
                extra = proposal.extra | {"selection": batch.method, "selected_by": chosen}
                proposal = proposal.model_copy(update={"extra": extra})
            else:
                self.searched.update({str(run.details["sha256"]): run.id for run in runs})
            brief = Brief(
                mission=Mission.of(self.world, route),
                requirement=requirement,
                kind="new" if number == 0 or batch.repeats else "refine",
                seed=0,
                scenario_index=batch.scenario,
                configuration_index=number,
            )
            measured = tuple(_measurement(run, requirement.metric if requirement else None) for run in runs)
            attempt = Attempt(
                campaign=name,
                index=index + offset,
                purpose="confirmation" if batch.repeats else "search",
                strategy=STRATEGY[batch.method],
                brief=brief,
                proposal=proposal,
                measurements=measured,
                failures=tuple(failures),
                verdict=judge(requirement, [m.objective for m in measured]) if requirement and measured else None,
            )
            yield attempt, runs

    def _proposal(self, batch: Batch, file: Path | None, number: int, description: str, route: Route) -> Proposal:
        model = "unknown"
        read = ReadPeople(None, {}, [])
        problems: list[Finding] = []
        if file is None:
            self._find(batch.folder, "configuration", f"there is no configuration {number}")
            problems.append(Finding(rule="import", reason="the configuration is missing"))
        else:
            read = read_people(file, self.world.grid.valid)
            model = shown(Path(file.stem.partition("_")[2].rpartition("_")[0] or model))
            for kind, message in read.odd:
                self._find(file, kind, message)
                problems.append(Finding(rule=f"import.{kind}", reason=message))
        scenario = None
        if read.people is not None:
            scenario = Scenario(mission=Mission.of(self.world, route), people=read.people, description=description)
        extra = {"tasks": read.tasks, "description": description}
        return Proposal(generator=f"imported:{model}", scenario=scenario, first_findings=tuple(problems), extra=extra)

    def _run(
        self,
        path: Path,
        number: int,
        scenario_id: str,
        route: Route,
        logged: dict[str, float | None] | None,
        completed: bool | None,
    ) -> Run | Failure:
        """Return the run of a log, or a Failure with the reason; differences to the logged metrics become findings."""
        try:
            trajectory, last_row = read_log(path)
            finished = completed if completed is not None else last_row
            if finished is None:
                raise Unreadable("neither it nor log.csv says whether the run completed")
        except Unreadable as reason:
            self._find(path, "log", f"not imported: {reason}")
            self.done.refused += 1
            return Failure(seed=number, reason=str(reason))
        if last_row is not None and completed is not None and last_row != completed:
            self._find(
                path, "metrics", f"its last row says completed {last_row}, log.csv says {completed}; log.csv holds"
            )
        content = hashlib.sha256(read_bytes(path, largest=LARGEST_LOG)).hexdigest()
        people = trajectory.human_x.shape[1]
        run = Run(
            scenario_id=scenario_id,
            simulator=SIMULATOR,
            options={"sha256": content},
            seed=number,
            outcome=Outcome.REACHED if finished else Outcome.TIMED_OUT,
            trajectory=trajectory,
            log=trajectory,
            human_names=tuple(f"Human {i + 1}" for i in range(people)),
            human_radius_m=(HUMAN_RADIUS_M,) * people,
            goal=(route.goal.x, route.goal.y, route.goal.yaw),
            time_limit_s=route.time_limit_s,
            details={
                "file": shown(path, self.root),
                "sha256": content,
                "logged": {LOGGED[name]: value for name, value in (logged or {}).items()},
            },
        )
        self._compare(path, run, logged)
        return run

    def _compare(self, path: Path, run: Run, logged: dict[str, float | None] | None) -> None:
        if logged is None:
            self._find(path, "metrics", "log.csv has no row for this run: nothing to compare with")
            return
        ours = measure(run, LOGGED.values())
        self.done.compared += 1
        for name, metric in LOGGED.items():
            theirs, own = logged.get(name), ours[metric]
            if theirs is None or own is None:
                continue
            if abs(own - theirs) > TOLERANCE.get(metric, EXACT):
                self.done.differing += 1
                self._find(path, "metrics", f"log.csv says {name} = {theirs!r}, the log gives {own!r}")

    def _find(self, path: Path, kind: Kind, message: str) -> None:
        self.done.findings.append(ImportFinding(file=shown(path, self.root), kind=kind, message=message))


def _measurement(run: Run, objective: str | None) -> Measurement:
    values = measure(run)
    return Measurement(
        run_id=run.id,
        seed=run.seed,
        outcome=run.outcome.value,
        values=values,
        objective=values[objective] if objective else None,
    )


def write_findings(findings: Iterable[ImportFinding], path: Path, *, keep: bool = False) -> int:
    """Write findings as CSV (file, kind, message) and return how many the file holds.

    With `keep` those already in the file stay, so that a store that is added to keeps the defects of its runs.
    Raises FileError if the file cannot be read or written.
    """
    rows: list[tuple[str, ...]] = [(finding.file, finding.kind, finding.message) for finding in findings]
    if keep and path.is_file():
        try:
            header, earlier = read_table(path)
        except Unreadable as error:
            raise FileError(path, f"{error}. Move the file away to write a new one.") from None
        if tuple(header) != COLUMNS or any(len(row) != len(COLUMNS) for row in earlier):
            raise FileError(path, "this is not a list of findings. Move the file away to write a new one.")
        rows = list(dict.fromkeys([*map(tuple, earlier), *rows]))
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\r\n")
    writer.writerow(COLUMNS)
    writer.writerows(rows)
    write_whole(path, text.getvalue())
    return len(rows)
