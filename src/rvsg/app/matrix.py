"""Several campaigns at once: every route with every requirement, each in a folder of its own.

The campaigns share the workers of one machine. A campaign's records do not depend on its workers, so they are those
that the campaign makes alone.
"""

from __future__ import annotations

import itertools
import json
import queue
import re
import shlex
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from rvsg.app.campaign import Campaign, campaigns_in
from rvsg.app.commands import command_for
from rvsg.app.folder import MATRIX, REPORT, alone_in, check_out, holds_several, is_matrix, reading, store_of
from rvsg.app.input_files import as_stored, copy_inputs, located, paths_of
from rvsg.app.record import differences, other_settings
from rvsg.app.settings import (
    BUDGETS,
    LISTED,
    CampaignConfig,
    CampaignFile,
    called,
    effective,
    of_start,
    option_of,
    safe_name,
)
from rvsg.app.wiring import jobs_of, wire
from rvsg.core.documents import mistakes_of
from rvsg.core.errors import FileError, InputError, RvsgError
from rvsg.core.files import make_folder, write_whole
from rvsg.core.inputs import exists, parse_json, read_text
from rvsg.core.plugins import find_format, ignore
from rvsg.report.junit import junit_of
from rvsg.report.overview import Pin, Reported, pins_of, write_overview
from rvsg.report.result import Result
from rvsg.runs.worker_pool import Processes
from rvsg.scenario.requirement import shipped_requirements
from rvsg.search.execution import Event
from rvsg.world.world_folder import load_world

Pair = tuple[str, str]
FROM = "from"
"""The key of the folder that relative paths are read from."""
PAIRS = "pairs"
"""The key of the pairs asked for, where they are not every route with every requirement."""
ENDING_S = 20.0
"""Seconds that cancelled campaigns may take to finish their runs in progress."""


@dataclass(frozen=True, kw_only=True)
class CampaignEnded:
    """A campaign of a matrix ended: with an error, or None if it is finished or was cancelled."""

    error: BaseException | None


@dataclass(frozen=True, kw_only=True)
class Matrix:
    """Campaigns on several routes and requirements, in one folder."""

    folder: Path
    pairs: tuple[Pair, ...]
    """The route and the requirement of each campaign asked for."""
    settings: dict[str, Any]
    """All other settings."""
    stored: tuple[Pair, ...] = ()
    """The pairs that the folder holds already."""
    paths: dict[str, str]
    """The typed paths among the settings, with where they are."""
    begun_in: str
    """The folder that relative paths are read from."""
    named: tuple[Any, ...] = ()
    """What the user names now; code that only a file or a folder names is not run."""

    @classmethod
    def of(cls, from_file: Mapping[str, Any], given: Mapping[str, Any]) -> Matrix | None:
        """Return the matrix that settings ask for, with what its folder holds; None for an ordinary campaign.

        Raises:
            InputError: the folder holds a matrix with other settings.
        """
        asked = {**from_file, **given}
        stored = _stored(Path(asked["out"])) if asked.get("out") else {}
        begun_in = stored.pop(FROM, None) or str(Path.cwd())
        product = itertools.product(*(_names(stored.get(key, [])) for key in LISTED))
        stored_pairs = tuple((route, requirement) for route, requirement in stored.pop(PAIRS, product))
        paths = paths_of(stored, begun_in, Path(asked["out"])) if stored else {}
        asked = as_stored(asked, paths)
        values = of_start({**stored, **asked})
        names = {key: _names(values.get(key, CampaignConfig.model_fields[key].default)) for key in LISTED}
        if not stored and all(len(named) == 1 and named != ["all"] for named in names.values()):
            return None
        rest = {key: value for key, value in values.items() if key not in LISTED}
        world = rest.get("world", "warehouse")
        routes, requirements = _every(names, paths.get(world, world))
        together = {"route": "+".join(names["route"]), "requirement": "+".join(map(called, requirements))}
        default = effective(None, {}, rest | together)
        rest["out"] = str(default.folder)
        _check_same(stored, values, default.folder)
        pairs = _asked(tuple(itertools.product(routes, requirements)), [key in asked for key in LISTED], stored_pairs)
        folder = default.folder
        fields: dict[str, Any] = {"folder": folder, "pairs": pairs, "settings": rest, "stored": stored_pairs}
        return cls(**fields, paths=paths, begun_in=begun_in, named=(given,))

    @classmethod
    def open(cls, folder: Path) -> Matrix:
        """Open the matrix stored in a folder; InputError if there is none."""
        matrix = cls.of({}, {"out": str(folder)})
        if matrix is None:
            raise InputError(f"{folder}: this folder holds no campaigns on several routes or requirements.")
        return matrix

    @property
    def all_pairs(self) -> tuple[Pair, ...]:
        """The pairs of the folder, with those asked for now."""
        return tuple(dict.fromkeys([*self.stored, *self.pairs]))

    @property
    def resume_command(self) -> str:
        """The command that resumes all campaigns of the folder."""
        return shlex.join(["rvsg", "run", "--out", str(self.folder)])

    @property
    def jobs(self) -> int:
        """The number of workers."""
        return jobs_of(effective(None, {}, self.settings))

    @property
    def budget(self) -> dict[str, Any]:
        """What a model may cost in each campaign: an equal part of what is set for all of them together."""
        count, share = len(self.pairs), dict[str, Any]()
        for key in BUDGETS:
            budget = self.settings.get(key)
            if budget is None or count == 1:
                continue
            share[key] = budget / count if key == "budget_usd" else int(budget) // count
            if not share[key] and budget:
                option = f"{option_of(key)} {budget}"
                raise InputError(
                    f"{option} is less than one for each of the {count} campaigns.", code="budget-too-small"
                )
        return share

    def commands(self, typed: Callable[[str], str] = str) -> str:
        """Return the command that repeats the campaigns; one after the other where they are not a full product."""
        rest = command_for(located(effective(None, {}, self.settings), self.paths)).removeprefix("rvsg run ")
        together: dict[tuple[str, ...], list[str]] = {}
        for route in dict.fromkeys(route for route, _ in self.pairs):
            requirements = tuple(requirement for of, requirement in self.pairs if of == route)
            together.setdefault(requirements, []).append(route)
        commands = []
        for requirements, routes in together.items():
            words = [("--route", name) for name in routes] + [
                ("--requirement", self.paths.get(name, name)) for name in requirements
            ]
            commands.append(f"rvsg run {shlex.join(word for pair in words for word in pair)} {rest}")
        return " && ".join(typed(command) for command in commands)

    def create(self, on_message: Callable[[str], None] = ignore) -> list[Campaign]:
        """Create or resume every campaign asked for; a mistake in any of them is raised before one begins."""
        check_out(self.folder)
        if store_of(self.folder) is not None:
            raise InputError(
                f"{self.folder}: this folder holds a single campaign. Choose another --out for several.",
                code="out-single",
            )
        values = self._values()
        make_folder(self.folder)
        listed = {key: list(dict.fromkeys(pair[at] for pair in self.all_pairs)) for at, key in enumerate(LISTED)}
        content = self.settings | listed | {PAIRS: self.all_pairs, FROM: self.begun_in}
        with alone_in(self.folder):
            copy_inputs(content, self.paths, self.folder, anew=not self.stored)
            write_whole(self.folder / MATRIX, json.dumps(content, indent=2, ensure_ascii=False) + "\n")
        return [
            Campaign.create(
                file=settings, on_message=on_message, paths=self.paths, begun_in=self.begun_in, named=self.named
            )
            for settings in values
        ]

    def run(self, campaigns: Sequence[Campaign]) -> Iterator[tuple[Campaign, Event | CampaignEnded]]:
        """Run campaigns side by side on the workers of the matrix, yielding the events of each.

        An error ends one campaign, not the others. Closing the iterator cancels all of them.
        """
        jobs = min(self.jobs, 1024)
        with alone_in(self.folder):
            if jobs == 1 or len(campaigns) == 1:
                yield from _one_by_one(campaigns, jobs)
            else:
                yield from _side_by_side(campaigns, jobs)

    def campaigns(self) -> list[Campaign]:
        """Return the campaigns of the folder that have begun, route_2 before route_10."""
        return [campaign for folder in folders_in(self.folder) for campaign in campaigns_in(folder, optional=True)]

    def report(self) -> Path:
        """Write the overview that leads to the report of each campaign; return its path."""
        campaigns = self.campaigns()
        return report_all(self.folder, campaigns, self.commands(), missing=len(self.all_pairs) - len(campaigns))

    def _values(self) -> list[dict[str, Any]]:
        """Return the settings of each campaign, checked."""
        by_name: dict[str, dict[str, Any]] = {}
        for route, requirement in self.pairs:
            values = self.settings | self.budget | {"route": route, "requirement": requirement}
            plan = wire(located(effective(None, {}, values), self.paths)).plan
            name = f"{plan.mission.route.name}-{plan.requirement.name}"
            folder = str(self.folder / safe_name(name))
            if name in by_name:
                raise InputError(f"Two of the requirements are called {plan.requirement.name}. Rename one of them.")
            if any(folder == other["out"] for other in by_name.values()):
                raise InputError(
                    f"Two of the campaigns would be kept in {folder}. Rename a route or a requirement.",
                    code="matrix-folder-shared",
                )
            by_name[name] = values | {"out": folder, "junit": None}
        return list(by_name.values())


def report_all(folder: Path, campaigns: Sequence[Campaign], command: str, *, missing: int = 0) -> Path:
    """Write the overview of campaigns in folders of one folder, if there is any; return its path.

    Args:
        command: The commands that repeat them.
        missing: How many more have not begun.
    """
    page, reported, pins = folder / REPORT, list[Reported](), list[Pin]()
    for campaign in campaigns:
        link = f"{campaign.folder.name}/{campaign.page().name}"
        with campaign.result() as result:
            reported.append((link, result))
            pins += pins_of(link, result)
    if reported:
        write_overview(page, reported, command=command, missing=missing, pins=pins)
    return page


def folders_in(folder: Path) -> list[Path]:
    """Return the folders of the campaigns in a folder, route_2 before route_10."""

    def order(path: Path) -> list[tuple[int, str]]:
        return [(int(part) if part.isdecimal() else -1, part) for part in re.split(r"(\d+)", path.name)]

    return sorted((path for path in folder.iterdir() if path.is_dir() and store_of(path)), key=order)


def _one_by_one(campaigns: Sequence[Campaign], jobs: int) -> Iterator[tuple[Campaign, Event | CampaignEnded]]:
    for campaign in campaigns:
        try:
            for event in campaign.run(jobs=jobs):
                yield campaign, event
        except RvsgError as error:
            yield campaign, CampaignEnded(error=error)
        else:
            yield campaign, CampaignEnded(error=None)


def _side_by_side(campaigns: Sequence[Campaign], jobs: int) -> Iterator[tuple[Campaign, Event | CampaignEnded]]:
    """Run each campaign in a thread of its own, with its part of the workers."""
    events: queue.Queue[tuple[Campaign, Event | CampaignEnded]] = queue.Queue()
    waiting, threads = deque(campaigns), list[threading.Thread]()
    running: dict[int, int] = {}

    def work(campaign: Campaign, workers: int) -> None:
        try:
            for event in campaign.run(executor=Processes(workers)):
                events.put((campaign, event))
        except BaseException as error:
            events.put((campaign, CampaignEnded(error=error)))
        else:
            events.put((campaign, CampaignEnded(error=None)))

    try:
        while waiting or running:
            while waiting and (free := jobs - sum(running.values())) > 0:
                campaign = waiting.popleft()
                running[id(campaign)] = max(1, free // (len(waiting) + 1))
                thread = threading.Thread(target=work, args=(campaign, running[id(campaign)]), daemon=True)
                threads.append(thread)
                thread.start()
            campaign, event = events.get()
            if isinstance(event, CampaignEnded):
                del running[id(campaign)]
            yield campaign, event
    finally:
        for campaign in campaigns:
            campaign.cancel()
        for thread in threads:
            thread.join(ENDING_S)


def _asked(every: Sequence[Pair], given: Sequence[bool], stored: Sequence[Pair]) -> tuple[Pair, ...]:
    """Return the pairs that are meant: with only routes or only requirements given, those stored of each, or all of a
    new one; with neither, those stored."""
    if not stored or all(given):
        return tuple(every)
    named = given.index(True) if any(given) else 0
    old = {pair[named] for pair in stored}
    return tuple(pair for pair in every if pair in stored or pair[named] not in old)


def _stored(folder: Path) -> dict[str, Any]:
    """Return the settings of the matrix stored in a folder; empty if there is none."""
    file = folder / MATRIX
    try:
        if not exists(file):
            return {}
        stored: dict[str, Any] = parse_json(read_text(file), file)
        besides = {key: stored[key] for key in (FROM, PAIRS) if key in stored}
        TypeAdapter(list[Pair]).validate_python(besides.get(PAIRS, []))
        CampaignFile.model_validate({key: value for key, value in stored.items() if key not in besides})
    except ValidationError as error:
        wrong = "; ".join(mistakes_of(error, CampaignFile))
        raise FileError(
            file, f"this is not what was stored: {wrong}. Choose another --out.", code="matrix-file"
        ) from None
    except (ValueError, TypeError, AttributeError) as error:
        raise FileError(file, f"cannot be read: {error}. Choose another --out.", code="matrix-file") from None
    return stored


def _check_same(stored: Mapping[str, Any], asked: Mapping[str, Any], folder: Path) -> None:
    """Refuse other settings than those stored; more pairs may be added."""
    if not stored:
        return
    then, now = (
        effective(None, {}, {key: value for key, value in values.items() if key not in LISTED}).deciding()
        for values in (stored, asked)
    )
    if changes := differences(then, now):
        raise other_settings(folder, changes)


def _names(value: Any) -> list[str]:
    return list(dict.fromkeys(value)) if isinstance(value, list | tuple) else [value]


def _every(names: dict[str, list[str]], world: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return routes and requirements by name, `all` spelled out."""
    routes, requirements = names["route"], names["requirement"]
    if routes == ["all"]:
        routes = [route.name for route in load_world(world).routes]
    if requirements == ["all"]:
        requirements = list(shipped_requirements())
    return tuple(routes), tuple(requirements)


def folders_of(store: Path, *, begin: str) -> list[Path]:
    """Return the folders of the campaigns of a store: of one campaign, or of several in folders of their own.

    Raises:
        InputError: none of several has begun; `begin` is the command that begins them.
    """
    paths = list(folders_in(store)) if holds_several(store) else [store]
    if not paths:
        raise InputError(f"{store}: none of its campaigns has begun. Begin them: {begin}", code="not-begun")
    return paths


def campaigns_of(paths: Sequence[Path], *, html: Path | None = None, optional: bool = False) -> dict[Campaign, Path]:
    """Return the campaigns of some folders with the pages that their reports are written to.

    Args:
        html: the page, of one campaign; by default beside it.
        optional: whether a store without a campaign is allowed.

    Raises:
        InputError: `html` names one page for several campaigns.
    """
    campaigns = [campaign for path in paths for campaign in campaigns_in(path, optional=optional)]
    if len(campaigns) > 1 and html is not None:
        raise InputError(
            f"{paths[0]}: {len(campaigns)} campaigns have a page each; --html names one. Report one at a time."
        )
    several = len(campaigns) > len(paths)
    return {campaign: html or campaign.page(several=several) for campaign in campaigns}


def overview(folder: Path, campaigns: Sequence[Campaign]) -> tuple[Path, Matrix | None]:
    """Write the overview of the campaigns in a folder; return its path, and what was asked where one command ran them.

    The pages of the campaigns must be written.
    """
    if is_matrix(folder):
        matrix = Matrix.open(folder)
        return matrix.report(), matrix
    return report_all(folder, campaigns, "\n".join(campaign.command for campaign in campaigns)), None


def write_junit(path: str | Path, results: Iterable[Result]) -> None:
    """Write the verdicts of campaigns as JUnit XML, a test suite for each."""
    write_whole(Path(path), junit_of(results))


def write_study_tables(stores: Sequence[Path], out: Path) -> list[str]:
    """Write the tables of the published study from stores; return notes on what could not be computed."""
    write_tables = find_format("tables", "study", "study")
    make_folder(out, option="--tables")
    with ExitStack() as stack:
        ledgers = [stack.enter_context(reading(store)) for store in stores]
        return list(write_tables(*ledgers, out=out))
