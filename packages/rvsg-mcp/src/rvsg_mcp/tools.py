"""The tools of an assistant: thin calls of what every other door calls, on files inside one workspace folder.

A path that leads out of the workspace is refused, and so is whatever would run code: a stack or a robot is a shipped
one or a file of data (no code is allowed in the whole process). What a person would be told in one message is the
error of the tool.
"""

from __future__ import annotations

import contextlib
import functools
import io
import json
import sys
import tempfile
import traceback
from collections.abc import Awaitable, Callable, Container, Iterator
from pathlib import Path
from typing import Any, Literal, ParamSpec, TypeVar

import anyio
import anyio.to_thread
from mcp.server.mcpserver import Context, Image, MCPServer
from mcp.server.mcpserver.exceptions import ToolError
from pydantic import BaseModel, Field

import rvsg
from rvsg.app.campaign import campaigns_below
from rvsg.app.folder import LEDGER
from rvsg.app.saved_scenario import rerun
from rvsg.core.errors import InputError, RvsgError
from rvsg.core.files import path_inside
from rvsg.core.inputs import parse_json
from rvsg.evaluation.story import story_of
from rvsg.report.film import shot_of_run, strip
from rvsg.report.result import Result
from rvsg.report.terminal import describe_case, describe_judgement
from rvsg.report.words import limit_in_words
from rvsg.robots.robot import shipped_robots
from rvsg.runs.attempt import Measurement
from rvsg.scenario.builder import FoundWith, load_scenario_in, save_scenario
from rvsg.scenario.requirement import shipped_requirements
from rvsg.scenario.scenario import Human
from rvsg.search.execution import Event, Message, RunFinished
from rvsg.simulation.stacks.stack_choice import listed_stacks, stack_class, stack_names
from rvsg.world.creation import create_world
from rvsg.world.drawing import draw_world
from rvsg.world.world_folder import shipped_worlds, world_summary

INSTRUCTIONS = """RVSG finds human behaviours that make a mobile robot violate a requirement, in simulation.
Begin with `catalogue` and `show_world`. Then either `run_campaign`, which searches and confirms by itself, and
`findings`; or `write_scenario` and `simulate`. Only runs that took no part in a search confirm a failure. `keep` puts
it into a suite, and `run_suite` repeats a suite with another robot or stack. Paths are relative to the workspace."""
PICTURE_PX = 1200
STRIP_PX = 420
"""Width of each picture of a strip."""

P = ParamSpec("P")
T = TypeVar("T")


class Person(BaseModel):
    """A person who goes round waypoints by the shortest ways, again and again."""

    name: str
    waypoints: list[str] = Field(min_length=2, description="Names such as E15, in order.")
    pauses_s: dict[str, float] = Field(default={}, description="Seconds to stand still, by waypoint.")
    behaviour: str = Field(default="regular", description="regular, impassive, surprised, scared, curious, threatening")
    attention: str = Field(default="attentive", description="attentive, distracted, unseeing")
    speed_m_s: float = 1.5
    start_delay_s: float = 0.0


class AssistantFolder:
    """The folder that an assistant may read and write."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder.resolve()

    def path(self, name: str) -> Path:
        """Return a path inside the folder; InputError for one outside."""
        return path_inside(self.folder, name)

    def either(self, name: str, shipped: Container[str]) -> str:
        """Return the name of something shipped as it is, and anything else as a path inside the folder."""
        return name if name in shipped else str(self.path(name))

    def world(self, name: str) -> str:
        """Return a shipped world, or the path of a world folder."""
        return self.either(name, shipped_worlds())

    def requirement(self, name: str) -> str:
        """Return a shipped requirement, or the path of a file of them."""
        return self.either(name, shipped_requirements())

    def robot(self, name: str) -> str:
        """Return a shipped robot, or the path of a robot file."""
        return self.either(name, shipped_robots())

    def stack(self, name: str | None) -> str | None:
        """Return a registered stack, or the path of a file of parameters; InputError for one that runs elsewhere."""
        if name in stack_names() and not getattr(stack_class(name), "repeatable", True):
            raise InputError(f"{name} waits for programs outside of RVSG. Run it with `rvsg simulate --stack {name}`.")
        return None if name is None else self.either(name, stack_names())

    def save(self, scenario: rvsg.Scenario, path: Path, found: FoundWith | None = None) -> None:
        """Write a scenario to a new file, or over another scenario; InputError for any other file."""
        if path.suffix != ".json":
            raise InputError(f"{path.name}: a scenario is kept in a file that ends in .json.")
        if path.exists():
            try:
                load_scenario_in(path)
            except RvsgError as error:
                raise InputError(f"{path.name} is there and is no scenario. Choose another name. ({error})") from None
        save_scenario(scenario, path, found)


def told(tool: Callable[P, T]) -> Callable[P, Awaitable[T]]:
    """Return the tool in a thread that a cancelled call leaves at once, with every error as one of the tool."""

    @functools.wraps(tool)
    async def telling(*args: P.args, **options: P.kwargs) -> T:
        with reasons():
            return await anyio.to_thread.run_sync(functools.partial(tool, *args, **options), abandon_on_cancel=True)

    return telling


@contextlib.contextmanager
def reasons() -> Iterator[None]:
    """Turn every error inside into one of the tool that says why; the SDK would leave out all but the name."""
    try:
        yield
    except RvsgError as error:
        raise ToolError(str(error)) from error
    except Exception as unexpected:
        traceback.print_exc(file=sys.stderr)
        raise ToolError(f"Error in RVSG itself: {type(unexpected).__name__}: {unexpected}") from unexpected


class Server(MCPServer[Any]):
    """A server that refuses what the SDK would leave out in silence: arguments that a tool does not have."""

    async def call_tool(self, name: str, arguments: dict[str, Any], context: Any = None) -> Any:
        """Call a tool; ToolError where its arguments are unknown, nested too deep, or no values of JSON."""
        with reasons():
            parse_json(json.dumps(arguments), Path("arguments"))
            known = {each.name: list(each.input_schema["properties"]) for each in await self.list_tools()}
            if wrong := [each for each in arguments if each not in known.get(name, arguments)]:
                raise InputError(f"{name} has no argument {wrong[0]!r}. It has: {', '.join(known[name]) or 'none'}.")
        return await super().call_tool(name, arguments, context)


def server(folder: Path) -> MCPServer[Any]:
    """Return the server of a workspace."""
    made = Server("rvsg", instructions=INSTRUCTIONS, version=rvsg.__version__, log_level="WARNING")
    tools = Tools(AssistantFolder(folder))
    for tool in (
        tools.catalogue, tools.show_world, tools.new_world, tools.write_scenario, tools.simulate, tools.campaigns,
        tools.findings, tools.keep, tools.run_suite,
    ):  # fmt: skip
        made.add_tool(told(tool))
    made.add_tool(tools.run_campaign)
    return made


class Tools:
    """The tools, by the name an assistant calls them."""

    def __init__(self, workspace: AssistantFolder) -> None:
        self.workspace = workspace

    def catalogue(self) -> dict[str, Any]:
        """List worlds, robots, navigation stacks and requirements that can be named."""
        own = sorted(path.parent for path in self.workspace.folder.glob("**/world.yaml"))
        return {
            "worlds": [*shipped_worlds(), *(str(path.relative_to(self.workspace.folder)) for path in own)],
            "robots": list(shipped_robots()),
            "stacks": {each["name"]: each["title"] for each in listed_stacks()},
            "requirements": {name: _described(each) for name, each in shipped_requirements().items()},
        }

    def show_world(self, world: str) -> list[dict[str, Any] | Image]:
        """Describe a world: routes, areas with their waypoints, and a picture with the grid of waypoints."""
        loaded = rvsg.load_world(self.workspace.world(world))
        with tempfile.TemporaryDirectory() as folder:
            written = draw_world(loaded, Path(folder), what="grid", width=PICTURE_PX)
            pictures = [Image(data=path.read_bytes(), format="png") for path, _ in written]
        return [world_summary(loaded), *pictures]

    def new_world(self, map_file: str, name: str) -> list[str]:
        """Make the folder of a world from a Nav2 map (map.yaml beside its picture); labels and routes are proposed."""
        folder = self.workspace.path(name)
        created, remarks = create_world(folder, map_file=self.workspace.path(map_file))
        return [*created.notes, *(str(remark) for remark in remarks)]

    def write_scenario(
        self, file: str, world: str, route: str, people: list[Person], description: str = "", robot: str = "tiago_omni"
    ) -> str:
        """Write a scenario to a file: a robot on a route, and people who walk. It is checked; each finding is told."""
        walks = [rvsg.walk(p.name, *p.waypoints, **p.model_dump(exclude={"name", "waypoints"})) for p in people]
        place, driven = self.workspace.world(world), self.workspace.robot(robot)
        made = rvsg.scenario(place, route, walks, description=description, robot=driven)
        self.workspace.save(made, self.workspace.path(file))
        return f"{file} holds a valid scenario."

    def simulate(
        self, scenario: str, requirement: str | None = None, runs: int = 10, first_seed: int = 0,
        stack: str | None = None, robot: str | None = None,
    ) -> list[str | Image]:  # fmt: skip
        """Simulate a scenario file and judge a requirement: a verdict, the worst run as a story, and pictures of its
        decisive moments. A verdict takes at most 30 runs. Seeds count up from `first_seed`, and the same seed gives the
        same run: confirm a scenario that you chose by its runs with seeds that it has not had. Stack, robot and
        requirement are those that the scenario was found with, unless you name others.
        """
        given = {"stack": self.workspace.stack(stack), "robot": self.workspace.robot(robot) if robot else None}
        said: list[str] = []
        again = rerun(
            self.workspace.path(scenario), {key: value for key, value in given.items() if value},
            requirement=self.workspace.requirement(requirement) if requirement else None, on_message=said.append,
        )  # fmt: skip
        loaded, world = again.scenario, again.world
        done = rvsg.simulate(loaded, range(first_seed, first_seed + runs), world=world, simulator=again.simulator)
        judged = rvsg.judge(done, again.requirement, world=world)
        valued = [m for m in judged.measurements if m.objective is not None]
        lines: list[str | Image] = ["\n".join([*said, *describe_judgement(judged, done)])]
        if valued:
            worst = max(valued, key=lambda m: judged.requirement.badness(m.objective or 0.0))
            run = next(run for run in done if run.id == worst.run_id)
            lines += _shown(run, worst, judged.requirement, world, loaded)
        return lines

    async def run_campaign(
        self, context: Context[Any], out: str, world: str, route: str, requirement: str = "R1", scenarios: int = 10,
        robot: str = "tiago_omni", stack: str | None = None, humans: int = 2, seed: int = 0,
        simulator: Literal["embedded", "kinematic"] = "embedded",
    ) -> list[str | Image]:  # fmt: skip
        """Search for scenarios that violate a requirement, confirm the worst with new seeds, and name the cause. Takes
        minutes. Called again with the same settings, it goes on where it was stopped. The simulator `kinematic` has no
        physics: only to try things out.
        """
        with reasons():
            campaign = rvsg.Campaign.create(
                self.workspace.path(out), world=self.workspace.world(world), route=route,
                requirement=self.workspace.requirement(requirement), scenarios=scenarios, humans=humans, seed=seed,
                simulator=simulator, stack=self.workspace.stack(stack),
                robot=self.workspace.robot(robot),
            )  # fmt: skip
            total, done = campaign.plan.search_runs, 0
            events, ended = campaign.run(), object()
            try:
                while (event := await anyio.to_thread.run_sync(next, events, ended)) is not ended:
                    assert isinstance(event, Event)
                    done += isinstance(event, RunFinished)
                    if isinstance(event, RunFinished | Message):
                        text = event.text if isinstance(event, Message) else f"{done} runs"
                        await context.report_progress(done, max(total, done), text)
            finally:
                campaign.cancel()
            await anyio.to_thread.run_sync(campaign.report)
            return await anyio.to_thread.run_sync(self.findings, out)

    def campaigns(self) -> dict[str, str]:
        """List the campaigns of the workspace, each with what it found."""
        if not any(self.workspace.folder.rglob(LEDGER)):
            return {}
        found = campaigns_below(self.workspace.folder)
        return {str(each.folder.relative_to(self.workspace.folder)): each.answer.headline for each in found}

    def findings(self, campaign: str, number: str = "") -> list[str | Image]:
        """Tell what a campaign found. With a `number` such as 3.2, who walks where in that configuration, a picture of
        its decisive moments, and the file that its scenario is saved to for `simulate` and `keep`.
        """
        opened = rvsg.Campaign.open(self.workspace.path(campaign))
        with opened.result() as result:
            if number:
                return self._finding(opened, result, number)
            answer = result.answer
        lines = [answer.headline, answer.counts, *(f"{f.label}: {f.value} {f.note}".strip() for f in answer.figures)]
        lines += [each.text for each in (answer.alone, answer.elsewhere) if each is not None]
        for row in answer.shown:
            lines.append(f"{row.number} {row.status}: {row.name}")
            lines.append(f"    violated in {row.share}, {row.measured}; contact in {row.contact} {row.touch}")
            lines.append(f"    cause: {row.cause} ({row.caused}) {row.shrunk}".rstrip())
        return ["\n".join(lines)]

    def _finding(self, campaign: rvsg.Campaign, result: Result, number: str) -> list[str | Image]:
        rows = {row.number: row for row in result.answer.rows}
        if (row := rows.get(number)) is None:
            raise InputError(f"There is no {number}. There are {', '.join(rows)}.")
        attempt = next(attempt for attempt in result.attempts if attempt.index == row.shown_attempt)
        scenario, run = attempt.proposal.scenario, result.run_of(row.run)
        assert scenario is not None, "a row has runs"
        measured = next(measured for measured in attempt.measurements if measured.run_id == row.run)
        file = campaign.folder / f"scenario-{number}.json"
        self.workspace.save(scenario, file, campaign.found_with)
        return [
            scenario.description,
            *map(_in_words, scenario.people.humans),
            f"Saved to {file.relative_to(self.workspace.folder)}.",
            *_shown(run, measured, campaign.requirement, campaign.world, scenario),
        ]

    def keep(
        self, suite: str, scenario: str, requirement: str | None = None, expected: str = "violation", reason: str = ""
    ) -> str:
        """Add a scenario to a suite: a known failure (`violation`) or one that the robot must master (`pass`)."""
        folder = self.workspace.path(suite)
        opened = rvsg.Suite.open(folder) if folder.exists() else rvsg.Suite.create(folder)
        source = self.workspace.path(scenario)
        judged_by = self.workspace.requirement(requirement) if requirement else None
        added = opened.add(source, judged_by, expected=expected, reason=reason or None)
        return f"{suite} has {len(added.cases)} cases."

    def run_suite(self, suite: str, stack: str | None = None, robot: str | None = None) -> list[str]:
        """Run a suite, also with another robot or navigation stack; a line for each case."""
        opened = rvsg.Suite.open(self.workspace.path(suite))
        result = opened.run(stack=self.workspace.stack(stack), robot=self.workspace.robot(robot) if robot else None)
        return [describe_case(case) for case in result.cases]


def _described(requirement: rvsg.Requirement) -> str:
    return f"{requirement.text} {requirement.measured_as}; limit: {limit_in_words(requirement) or 'none'}"


def _in_words(human: Human) -> str:
    """Return who walks where, how fast and how."""
    tasks = "; ".join(f"{task.name} by {' '.join(task.path)}" for task in human.tasks)
    return f"{human.name} ({human.behaviour.value}, {human.attention.value}, {human.speed_m_s} m/s): {tasks}"


def _shown(
    run: rvsg.Run, measured: Measurement, requirement: rvsg.Requirement, world: rvsg.World, scenario: rvsg.Scenario
) -> list[str | Image]:
    """Return the story of a run, and pictures of its decisive moments."""
    buffer = io.BytesIO()
    strip(shot_of_run(run, measured, requirement, world, scenario), STRIP_PX).save(buffer, "PNG")
    story = " ".join(each.text for each in story_of(run, world=world, scenario=scenario))
    return [story, Image(data=buffer.getvalue(), format="png")]
