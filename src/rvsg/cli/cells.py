"""Several campaigns of one command: every route with every requirement, each in a process and a folder of its own.

Such cells share nothing, so as many as there are cores run side by side, one process each; where there are more cores
than cells, a cell gets several. A campaign's records do not depend on its processes, so they are those that
`rvsg run` makes of the cell alone.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import queue
import re
import shlex
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rvsg.cli.console import as_started, print_json, say
from rvsg.core.errors import FileError, InputError, Interrupted

if TYPE_CHECKING:
    from rvsg.api.wiring import Wired
    from rvsg.campaign.plan import Plan
    from rvsg.report.summary import Summary

Pair = tuple[str, str]
LISTED = ("route", "requirement")
PAIRS = "pairs"
"""The key of the pairs that were asked for: not every route of the folder with every requirement."""
PATIENCE_S = 20.0
"""So long a cell that is interrupted may take to keep what it has."""
CHILD = "import sys; from rvsg.cli.cell import main; sys.exit(main())"


@dataclass(frozen=True, kw_only=True)
class Cells:
    """What is asked: pairs of a route and a requirement; `values` are all other settings.

    `kept` are the pairs that the folder holds already, `places` the settings' paths and where they are, seen from the
    present folder, and `begun_in` the folder that relative ones are read from.
    """

    folder: Path
    pairs: tuple[Pair, ...]
    values: dict[str, Any]
    kept: tuple[Pair, ...]
    places: dict[str, str]
    begun_in: str

    @property
    def all_pairs(self) -> tuple[Pair, ...]:
        """The pairs of the folder with those that are asked for now."""
        return tuple(dict.fromkeys([*self.kept, *self.pairs]))


@dataclass(kw_only=True)
class Cell:
    """One campaign of several: its settings, and how far it is."""

    name: str
    wired: Wired
    values: dict[str, Any]
    process: subprocess.Popen[str] | None = None
    jobs: int = 0
    code: int | None = None
    told: list[str] = field(default_factory=list)

    @property
    def folder(self) -> Path:
        """Where the cell is kept."""
        return Path(self.values["out"])


def cells_of(from_file: dict[str, Any], given: dict[str, Any]) -> Cells | None:
    """The cells that are asked for, those kept in the folder included; None where it is one ordinary campaign."""
    from rvsg.api.config import CampaignConfig, called, effective
    from rvsg.api.paths import as_stored as as_kept
    from rvsg.api.paths import paths_of as places_of
    from rvsg.api.record import FROM

    asked = {**from_file, **given}
    stored = _stored(Path(asked["out"])) if asked.get("out") else {}
    begun_in = stored.pop(FROM, None) or str(Path.cwd())
    every_stored = itertools.product(*(_names(stored.get(key, [])) for key in LISTED))
    kept = tuple((route, requirement) for route, requirement in stored.pop(PAIRS, every_stored))
    places = places_of(stored, begun_in)
    asked = as_kept(asked, places)
    values = {**stored, **asked}
    names = {key: _names(values.get(key, CampaignConfig.model_fields[key].default)) for key in LISTED}
    if not stored and all(len(found) == 1 and found != ["all"] for found in names.values()):
        return None
    rest = {key: value for key, value in values.items() if key not in LISTED}
    world = rest.get("world", "warehouse")
    routes, requirements = _every(names, places.get(world, world))
    together = {"route": "+".join(names["route"]), "requirement": "+".join(map(called, requirements))}
    default = effective(None, {}, rest | together)
    rest["out"] = str(default.folder)
    _same(stored, values, default.folder)
    every = tuple(itertools.product(routes, requirements))
    return Cells(
        folder=default.folder,
        pairs=_asked(every, [key in asked for key in LISTED], kept),
        values=rest,
        kept=kept,
        places=places,
        begun_in=begun_in,
    )


def _asked(every: Sequence[Pair], given: Sequence[bool], kept: Sequence[Pair]) -> tuple[Pair, ...]:
    """The pairs that are meant: where only routes or only requirements are given, those kept of each, or all of a
    new one; where neither is, those kept."""
    if not kept or all(given):
        return tuple(every)
    named = given.index(True) if any(given) else 0
    old = {pair[named] for pair in kept}
    return tuple(pair for pair in every if pair in kept or pair[named] not in old)


def run_cells(cells: Cells, *, as_json: bool) -> int:
    """Run or resume the campaigns of all cells, show what was found, and return the exit code."""
    from rvsg.api.folder import CELLS, alone_in, check_out, make_folder, store_of
    from rvsg.api.record import FROM
    from rvsg.api.records import check_writable
    from rvsg.api.wiring import jobs_of
    from rvsg.cli.interruption import interruptible
    from rvsg.core.files import write_whole

    begin = time.monotonic()
    check_out(cells.folder)
    if junit := cells.values.get("junit"):
        check_writable(Path(junit))
    if store_of(cells.folder) is not None:
        raise InputError(f"{cells.folder}: this folder holds a single campaign. Choose another --out for several.")
    all_of_them = _wired(cells)
    make_folder(cells.folder)
    listed = {key: list(dict.fromkeys(pair[at] for pair in cells.all_pairs)) for at, key in enumerate(LISTED)}
    settings = cells.values | listed | {PAIRS: cells.all_pairs, FROM: cells.begun_in}
    others = len(cells.all_pairs) - len(all_of_them)
    with alone_in(cells.folder):
        write_whole(cells.folder / CELLS, json.dumps(settings, indent=2, ensure_ascii=False) + "\n")
        jobs = jobs_of(all_of_them[0].wired.config)
        say(f"Campaigns in {cells.folder}: {len(all_of_them)}, of which {min(jobs, len(all_of_them))} side by side.")
        if others:
            say(f"{others} more in this folder were not asked for now; they go on with: {_resume(cells)}")
        if share := _share_of_budget(cells):
            told = ", ".join(f"--{key.replace('_', '-')} {value:g}" for key, value in share.items())
            say(f"The budget is for all of them together; each may spend its part: {told}.")
        with interruptible() as interruption, interruption.at_once(f"Interrupted. Resume with: {_resume(cells)}"):
            all_of_them[0].wired.simulator.prepare(say)
        _run_all(all_of_them, jobs, _resume(cells), cells.begun_in)
        kept = {path: found for path in folders_in(cells.folder) if (found := found_in(path)) is not None}
        write_overview_in(cells.folder, kept)
        summaries = [(cell, *kept[cell.folder]) for cell in all_of_them if cell.code == 0 and cell.folder in kept]
        _write_and_show(cells, all_of_them, summaries, time.monotonic() - begin, as_json=as_json)
    if broken := [cell for cell in all_of_them if cell.code != 0]:
        for cell in broken:
            say(f"{cell.name}: not finished. {cell.told[-1] if cell.told else ''}")
        say(f"The same command goes on with what is not finished: {_resume(cells)}")
        return max(cell.code or 0 for cell in broken)
    fail = all_of_them[0].wired.config.fail_on_violation
    return 1 if fail and any(summary.violated for _, _, summary in summaries) else 0


def _command(cells: Cells, typed: Callable[[str], str] = str) -> str:
    """The exact command that repeats the campaigns, with the budget that is for all of them together.

    Where they are not every route with every requirement, it is one command after the other.
    """
    from rvsg.api.commands import command_for
    from rvsg.api.config import effective

    rest = command_for(effective(None, {}, cells.values)).removeprefix("rvsg run ")
    together: dict[tuple[str, ...], list[str]] = {}
    for route in dict.fromkeys(route for route, _ in cells.pairs):
        requirements = tuple(requirement for of, requirement in cells.pairs if of == route)
        together.setdefault(requirements, []).append(route)
    commands = []
    for requirements, routes in together.items():
        asked = [("--route", name) for name in routes] + [("--requirement", name) for name in requirements]
        commands.append(f"rvsg run {shlex.join(word for pair in asked for word in pair)} {rest}")
    return " && ".join(typed(command) for command in commands)


def _resume(cells: Cells) -> str:
    """The command that goes on with all campaigns of the folder; their settings are kept there."""
    return as_started(shlex.join(["rvsg", "run", "--out", str(cells.folder)]))


def write_overview_in(folder: Path, kept: Mapping[Path, tuple[Plan, Summary]]) -> None:
    """Write the page over the campaigns kept in a folder; `kept` is what each found so far, by its own folder."""
    from rvsg.api.folder import REPORT
    from rvsg.report.overview import write_overview

    cells = cells_of({}, {"out": str(folder)})
    if kept and cells is not None:
        missing = len(cells.pairs) - len(kept)
        reported = [(f"{path.name}/{REPORT}", *found) for path, found in kept.items()]
        write_overview(folder / REPORT, reported, command=_command(cells), missing=missing)


def folders_in(folder: Path) -> list[Path]:
    """The folders of the campaigns kept in a folder, route_2 before route_10."""
    from rvsg.api.folder import store_of

    def order(path: Path) -> list[tuple[int, str]]:
        return [(int(part) if part.isdecimal() else -1, part) for part in re.split(r"(\d+)", path.name)]

    return sorted((path for path in folder.iterdir() if path.is_dir() and store_of(path)), key=order)


def found_in(folder: Path) -> tuple[Plan, Summary] | None:
    """What the campaign kept there found so far; None where there is none yet."""
    from rvsg.api.folder import reading, store_of
    from rvsg.campaign.plan import Plan
    from rvsg.report.summary import summarise

    if store_of(folder) is None:
        return None
    with reading(folder) as ledger:
        settings = [ledger.settings(name) for name in ledger.campaigns()]
        if not settings or settings[0] is None:
            return None
        plan = Plan.model_validate(settings[0]["plan"])
        return plan, summarise(plan, list(ledger.attempts(plan.name)))


def _stored(folder: Path) -> dict[str, Any]:
    """The settings of the campaigns kept in a folder; empty where there are none."""
    from pydantic import TypeAdapter, ValidationError

    from rvsg.api.config import CampaignFile
    from rvsg.api.folder import CELLS
    from rvsg.api.record import FROM
    from rvsg.core.documents import mistakes_of
    from rvsg.core.inputs import exists, parse_json, read_text

    try:
        if not exists(folder / CELLS):
            return {}
        stored = dict(parse_json(read_text(folder / CELLS), folder / CELLS))
        besides = {key: stored[key] for key in (FROM, PAIRS) if key in stored}
        TypeAdapter(list[Pair]).validate_python(besides.get(PAIRS, []))
        CampaignFile.model_validate({key: value for key, value in stored.items() if key not in besides})
    except ValidationError as error:
        wrong = "; ".join(mistakes_of(error, CampaignFile))
        raise FileError(folder / CELLS, f"this is not what was kept: {wrong}. Choose another --out.") from None
    except (ValueError, TypeError) as error:
        raise FileError(folder / CELLS, f"cannot be read: {error}. Choose another --out.") from None
    return stored


def _same(stored: dict[str, Any], asked: dict[str, Any], folder: Path) -> None:
    """Cells that are there already keep their settings; more cells may be added."""
    from rvsg.api.config import effective
    from rvsg.api.record import differences

    if not stored:
        return
    known, now = (
        effective(None, {}, {key: value for key, value in values.items() if key not in LISTED}).deciding()
        for values in (stored, asked)
    )
    if found := differences(known, now):
        listed = "\n".join(f"  - {line}" for line in found)
        raise InputError(
            f"{folder}: this folder holds campaigns with other settings:\n{listed}\n"
            "To resume them, leave these options out; for new ones choose another --out."
        )


def _names(value: Any) -> list[str]:
    return list(dict.fromkeys(value)) if isinstance(value, list | tuple) else [value]


def _every(names: dict[str, list[str]], world: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Routes and requirements by name, `all` spelt out."""
    from rvsg.scenario.requirements import shipped_requirements
    from rvsg.world.io.load import load_world

    routes, requirements = names["route"], names["requirement"]
    if routes == ["all"]:
        routes = [route.name for route in load_world(world).routes]
    if requirements == ["all"]:
        requirements = list(shipped_requirements())
    return tuple(routes), tuple(requirements)


def _wired(cells: Cells) -> list[Cell]:
    """Every cell with its parts made, so that a mistake in any of them is told before one begins."""
    from rvsg.api.config import effective, safe_name
    from rvsg.api.wiring import wire

    found: dict[str, Cell] = {}
    share = _share_of_budget(cells)
    for route, requirement in cells.pairs:
        values = cells.values | share | {"route": route, "requirement": requirement}
        wired = wire(effective(None, {}, values), cells.places)
        name = f"{wired.plan.mission.route.name}-{wired.plan.requirement.name}"
        folder = cells.folder / safe_name(name)
        if name in found:
            raise InputError(f"Two of the requirements are called {wired.plan.requirement.name}. Rename one of them.")
        if any(folder == cell.folder for cell in found.values()):
            raise InputError(f"Two of the campaigns would be kept in {folder}. Rename a route or a requirement.")
        found[name] = Cell(name=name, wired=wired, values=values | {"out": str(folder), "junit": None})
    return list(found.values())


def _share_of_budget(cells: Cells) -> dict[str, Any]:
    """What a model may cost in each cell: what is asked for is for all of them together, in equal parts."""
    from rvsg.api.config import BUDGETS

    count = len(cells.pairs)
    share: dict[str, Any] = {}
    for key in BUDGETS:
        budget = cells.values.get(key)
        if budget is None or count == 1:
            continue
        share[key] = budget / count if key == "budget_usd" else int(budget) // count
        if not share[key] and budget:
            raise InputError(f"--{key.replace('_', '-')} {budget} is less than one for each of the {count} campaigns.")
    return share


def _run_all(cells: Sequence[Cell], jobs: int, resume: str, begun_in: str) -> None:
    """Run the cells, as many side by side as there are jobs; an interruption reaches each of them once.

    `resume` is the command that goes on with them, `begun_in` the folder that their paths are read from."""
    from rvsg.cli.interruption import interruptible

    waiting, running = deque(cells), list[Cell]()
    lines: queue.Queue[tuple[Cell, str | None]] = queue.Queue()
    try:
        with interruptible() as interruption:
            while waiting or running:
                interruption.check()
                while waiting and (free := jobs - sum(cell.jobs for cell in running)) > 0:
                    cell = waiting.popleft()
                    running.append(cell)
                    _start(cell, max(1, free // (len(waiting) + 1)), lines, begun_in)
                cell, line = lines.get()
                if line is None:
                    running.remove(cell)
                    _ended(cell, cells)
                elif line:
                    cell.told.append(line)
                    say(f"{cell.name}: {line}")
    except KeyboardInterrupt:
        _end(running)
        raise Interrupted(f"Interrupted; what was finished is kept. Resume with: {resume}") from None
    except BaseException:
        _end(running)
        raise


def _start(cell: Cell, jobs: int, lines: queue.Queue[tuple[Cell, str | None]], begun_in: str) -> None:
    """Start the process of a cell in a group of its own: Ctrl-C in a terminal is for us, who pass it on once."""
    cell.jobs = jobs
    cell.process = subprocess.Popen(  # noqa: S603
        [sys.executable, "-c", CHILD, sys.argv[0]],
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        encoding="utf-8",
        errors="replace",
        start_new_session=True,
        cwd=begun_in if Path(begun_in).is_dir() else None,
    )
    threading.Thread(target=_listen, args=(cell, lines), daemon=True).start()
    assert cell.process.stdin is not None
    with contextlib.suppress(BrokenPipeError), cell.process.stdin as given:
        given.write(json.dumps(cell.values | {"jobs": jobs, "out": str(cell.folder.absolute())}))


def _listen(cell: Cell, lines: queue.Queue[tuple[Cell, str | None]]) -> None:
    assert cell.process is not None and cell.process.stderr is not None
    with cell.process.stderr as told:
        for line in told:
            lines.put((cell, line.rstrip()))
    cell.process.wait()
    lines.put((cell, None))


def _ended(cell: Cell, cells: Sequence[Cell]) -> None:
    assert cell.process is not None
    cell.code = cell.process.returncode
    if cell.code < 0:  # killed from outside: what is finished is kept
        cell.told.append(f"its process was ended by signal {-cell.code}.")
        cell.code = 3
    done = sum(other.code is not None for other in cells)
    say(f"{cell.name}: {'done' if cell.code == 0 else 'not finished'} ({done} of {len(cells)})")


def _end(running: Sequence[Cell]) -> None:
    """Interrupt the processes that are left and wait for them; those that do not end are killed."""
    processes = [cell.process for cell in running if cell.process is not None]
    for process in processes:
        with contextlib.suppress(ProcessLookupError):
            process.send_signal(signal.SIGINT)
    deadline = time.monotonic() + PATIENCE_S
    try:
        for process in processes:
            process.wait(timeout=max(0.1, deadline - time.monotonic()))
    except subprocess.TimeoutExpired:
        for process in processes:
            process.kill()


def _write_and_show(
    cells: Cells,
    all_of_them: Sequence[Cell],
    found: Sequence[tuple[Cell, Plan, Summary]],
    spent_s: float,
    *,
    as_json: bool,
) -> None:
    from rvsg.api.folder import REPORT
    from rvsg.cli.tables import cells_table
    from rvsg.core.files import write_whole
    from rvsg.report.junit import junit_of

    config = all_of_them[0].wired.config
    if config.junit:
        write_whole(Path(config.junit), junit_of([(plan, summary) for _, plan, summary in found]))
    command = _command(cells)
    if as_json:
        listed = [
            summary.model_dump(mode="json", exclude={"confirmed": {"brief", "proposal"}})
            | {"route": plan.mission.route.name, "requirement": plan.requirement.name}
            | {"out": str(cell.folder), "report": str(cell.folder / REPORT)}
            for cell, plan, summary in found
        ]
        overview = {"out": str(cells.folder), "report": str(cells.folder / REPORT), "command": command}
        print_json({"campaigns": listed, **overview})
    say(cells_table([(plan, summary) for _, plan, summary in found]))
    say(f"{len(found)} of {len(all_of_them)} campaigns done in {spent_s:.0f} s; kept in {cells.folder}")
    say(f"Reports: {cells.folder / REPORT}")
    say(f"Repeat it with: {_command(cells, as_started)}")
