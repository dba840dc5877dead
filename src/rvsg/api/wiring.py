"""From a configuration to the parts of a campaign. Everything is checked here, before anything is written."""

from __future__ import annotations

import json
import os
import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from rvsg.api.config import BESIDE, MACHINE, CampaignConfig
from rvsg.api.paths import spelt_out
from rvsg.campaign.loop import Parts, Watcher, feedback_from
from rvsg.campaign.measuring import Measuring
from rvsg.campaign.parallel import Executor, Simulations
from rvsg.campaign.plan import Plan
from rvsg.campaign.strategies import Strategy
from rvsg.core import plugins
from rvsg.core.errors import FileError, InputError, InvalidScenario, UnknownName
from rvsg.evaluation.judge import check_requirement
from rvsg.generation.generator import Generator
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.requirements import load_requirement
from rvsg.scenario.scenario import ROBOT, Mission, Scenario
from rvsg.scenario.validity import check, warnings
from rvsg.simulation.protocol import Simulator
from rvsg.world.io.load import load_world
from rvsg.world.space import robot_space
from rvsg.world.world import Route, World

WORDS = ("title", "text", "unit", "measured_as", "note", "source")
"""What of a requirement is said and decides no verdict."""

VLM_OPTIONS = (
    *("model", "base_url", "conversation", "prompts", "replay"),
    *("budget_usd", "budget_calls", "budget_tokens"),
)


@dataclass(frozen=True, kw_only=True)
class Wired:
    """A campaign that can begin: its plan and its parts, checked; `places` are its paths and where they are."""

    config: CampaignConfig
    plan: Plan
    world: World
    generator: Generator
    simulator: Simulator
    strategy_class: Any
    executor: Executor | None
    places: Mapping[str, str] = field(default_factory=dict)

    @property
    def file(self) -> str:
        """The campaign as a campaign file that means the same wherever it is read."""
        return CampaignConfig(**spelt_out(self.config.model_dump(), self.places)).to_yaml()

    @property
    def settings(self) -> dict[str, Any]:
        """What decides the records, as it is kept with the campaign."""
        return {
            "config": self.config.deciding(),
            "plan": self.plan.model_dump(mode="json"),
            "simulator": {"name": self.simulator.name, "options": dict(self.simulator.options)},
        }

    def in_words_of(self, stored: dict[str, Any], tell: Callable[[str], None]) -> Wired:
        """This campaign with the words its requirement had when it was begun, where what it measures is the same.

        Words decide no verdict, but a model reads them and records hold them: a campaign keeps those it was begun with.
        """
        now = self.plan.requirement
        try:
            then = Requirement.model_validate(stored["plan"]["requirement"])
        except (KeyError, TypeError, ValidationError):
            return self
        if then == now or then.replace(**{word: getattr(now, word) for word in WORDS}) != now:
            return self
        changed = ", ".join(word for word in WORDS if getattr(then, word) != getattr(now, word))
        tell(f"{now.name} is worded otherwise today ({changed}); this campaign keeps the words it was begun with.")
        return replace(self, plan=self.plan.replace(requirement=then))

    def strategy(self, ledger: Any) -> Strategy:
        """A fresh strategy that reads its feedback from the ledger."""
        made: Strategy = self.strategy_class(self.plan, feedback_from(ledger, self.plan, self.world), self.world)
        return made

    def warm_up(self, tell: Callable[[str], None]) -> None:
        """Let the simulator compile or load what it needs, if it has such a step, before workers and clocks start."""
        prepare = getattr(self.simulator, "prepare", None)
        if prepare is not None:
            prepare(tell)

    def simulations(self, ledger: Any = None, tell: Callable[[str], None] = lambda _: None) -> Simulations:
        """What makes the runs; those the ledger knows are not made again."""
        known = ledger.find if ledger is not None else None
        jobs = jobs_of(self.config)
        return Simulations(self.simulator, self.world, jobs=jobs, known=known, executor=self.executor, tell=tell)

    def parts(self, ledger: Any, simulations: Simulations, watch: Watcher) -> Parts:
        """What the loop works with."""
        measuring = Measuring(self.plan.requirement, self.world)
        return Parts(
            generator=self.generator,
            simulations=simulations,
            measure=measuring.measure,
            judge=measuring.judge,
            ledger=ledger,
            watch=watch,
        )


def wire(config: CampaignConfig, places: Mapping[str, str] | None = None) -> Wired:
    """Look everything up and make it; raises an InputError for the first thing that cannot be used.

    `places` says where paths of a campaign are that was begun in another folder.
    """
    places = places or {}
    world = load_world(places.get(config.world, config.world))
    route = world.route(config.route)
    check_start(route, world)
    requirement = requirement_of(places.get(config.requirement, config.requirement)).for_time_limit(route.time_limit_s)
    strategy_class = plugins.find("strategy", config.strategy)
    simulator = plugins.make("simulator", config.simulator, config.simulator_options)
    generator = plugins.make("generator", config.generator_name, generator_options(config, places))
    plugins.able("store", config.store, config.store_options, given=1)
    plan = Plan(
        name=f"{world.name}-{route.name}-{requirement.name}-{config.generator_name}-{config.strategy}-{config.seed}",
        mission=Mission(world=config.world, world_id=world.id, route=route),
        requirement=requirement,
        humans=config.humans,
        scenarios=config.scenarios,
        refinements=config.refinements,
        repeats=config.repeats,
        confirmations=config.confirmations,
        memory=config.memory,
        abreast=config.abreast,
        seed=config.seed,
    )
    return Wired(
        config=config,
        plan=plan,
        world=world,
        generator=generator,
        simulator=simulator,
        strategy_class=strategy_class,
        executor=executor_of(config),
        places=places,
    )


def executor_of(config: CampaignConfig) -> Executor | None:
    """What makes the runs beside this process; None for the processes of `jobs` on this machine."""
    if config.executor == "processes":
        if config.executor_options:
            raise InputError('The executor "processes" takes no options; --jobs is the number of processes.')
        return None
    made: Executor = plugins.make("executor", config.executor, config.executor_options)
    return made


def requirement_of(name_or_path: str) -> Requirement:
    """A requirement by name, or from a file, whose metric or formula can be measured."""
    return load_requirement(name_or_path, check=check_requirement)


def check_start(route: Route, world: World) -> None:
    """Refuse a route that begins or ends inside an obstacle."""
    space = robot_space(world)
    for what, pose in (("start", route.start), ("goal", route.goal)):
        if not space.is_free(pose.x, pose.y):
            raise InputError(
                f"{world.name}, {route.name}: the {what} pose ({pose.x:g}, {pose.y:g}) lies inside an obstacle or "
                "outside the map. Move it in routes.yaml; `rvsg world check` shows every such place."
            )


def world_of(scenario: Scenario, instead: str | None) -> World:
    """The world a scenario was made for, or another place where it is; InputError where it is not that world."""
    made_for, known = scenario.mission.world, scenario.mission.world_id
    world = load_world(instead or made_for)
    if world.id == known:
        return world
    if instead:
        raise InputError(
            f"The scenario was made for {made_for} ({known}), and --world {instead} is another world ({world.id}). "
            "Leave --world out, or give the place where the world it was made for is now."
        )
    raise InputError(
        f"The scenario was made for {made_for} ({known}), but that world is now {world.id}: its map, objects, grid or "
        "routes have changed. Propose a new scenario, or give a copy of the world it was made for with --world."
    )


def check_scenario(scenario: Scenario, world: World) -> tuple[str, ...]:
    """Refuse a scenario that breaks a rule, with every finding: nothing invalid reaches a simulator. What is only
    doubtful is returned in words."""
    check_start(scenario.mission.route, world)
    findings = check(scenario.people, scenario.mission, world)
    if findings:
        raise InvalidScenario("The scenario is not valid:", [str(finding) for finding in findings])
    return tuple(f"warning: {finding}" for finding in warnings(scenario.people, scenario.mission, world))


def check_robot(path: Path, scenario: Scenario, simulator: Simulator) -> None:
    """Refuse a scenario of a file whose robot the simulator does not drive.

    A simulator says in `robots` which it drives; one that does not say drives ours alone.
    """
    drives = getattr(simulator, "robots", (ROBOT,))
    if scenario.mission.robot not in drives:
        hint = (
            f'The simulator "{simulator.name}" drives no other; another robot comes in with a simulator of its own, '
            "see docs/how-to/write-a-plug-in.md."
        )
        raise FileError(path, f"mission.robot: {UnknownName('robot', scenario.mission.robot, drives, hint=hint)}")


def generator_options(config: CampaignConfig, places: Mapping[str, str]) -> dict[str, Any]:
    """What the generator is made with: its own options, and for a VLM how it is reached and kept within bounds."""
    if config.generator_name != "vlm":
        return dict(config.generator_options)
    reached = {name: getattr(config, name) for name in VLM_OPTIONS if getattr(config, name) is not None}
    reached |= {name: places.get(reached[name], reached[name]) for name in ("prompts", "replay") if name in reached}
    return {"folder": str(config.folder), **reached, **config.generator_options}


def jobs_of(config: CampaignConfig) -> int:
    """Worker processes: as asked, or one per core that is ours."""
    if config.jobs:
        return config.jobs
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:
        return os.cpu_count() or 1


def with_defaults(stored: dict[str, Any]) -> dict[str, Any]:
    """Stored settings with the defaults of what a later version added; as they are where they are no such settings."""
    try:
        plan = Plan.model_validate(stored["plan"]).model_dump(mode="json")
        config = CampaignConfig.model_validate(stored["config"]).deciding()
    except (KeyError, TypeError, ValidationError):
        return stored
    return stored | {"plan": plan, "config": config}


def differences(known: dict[str, Any], asked: dict[str, Any], prefix: str = "") -> list[str]:
    """Where the settings of a resumed campaign differ from those asked, as `key: known, now asked`."""
    found = []
    for key in sorted({*known, *asked}):
        a, b = known.get(key), asked.get(key)
        if isinstance(a, dict) and isinstance(b, dict):
            found += differences(a, b, f"{prefix}{key}.")
        elif a != b:
            found.append(f"{prefix}{key}: {a!r}, now {b!r}")
    return found


def command_for(config: CampaignConfig, *, out: Path | None = None) -> str:
    """The exact command that repeats a campaign: every option that is not the default, and always the seed."""
    words = _options(config, without=("out", *MACHINE, "junit", "fail_on_violation", "seed"))
    words += ["--seed", str(config.seed)]
    if out is not None:
        words += ["--out", str(out)]
    return shlex.join(["rvsg", "run", *words])


def command_for_more(config: CampaignConfig, made: int) -> str:
    """The command that decides what `made` fresh runs left open: the same campaign with more of them, in a new folder.

    The search and the fresh runs made so far are the same again, by their seeds; a model that was recorded is not asked
    again.
    """
    default = CampaignConfig().confirmations
    runs, recorded = max(default, 2 * made), config.folder / "vlm"
    replay = str(recorded) if (recorded / "calls.jsonl").exists() else config.replay
    again = config.replace(confirmations=default, replay=replay)
    new_folder = config.folder.with_name(f"{config.folder.name}-{runs}")
    return f"{command_for(again, out=new_folder)} --confirmations {runs}"


def resume_command(config: CampaignConfig, *, without: Sequence[str] = ()) -> str:
    """The command that goes on with a campaign: its folder, and the options that are not kept with it."""
    kept = [key for key in CampaignConfig.model_fields if key not in BESIDE]
    words = _options(config, without=("out", "store", "store_options", *kept, *without))
    return shlex.join(["rvsg", "run", "--out", str(config.folder), *words])


def _options(config: CampaignConfig, *, without: Sequence[str]) -> list[str]:
    """The options of `rvsg run` that give these settings: those that are not the default."""
    words: list[str] = []
    defaults = CampaignConfig()
    for key, value in config.model_dump(mode="json").items():
        option = f"--{key.replace('_', '-')}"
        if key in without or value == getattr(defaults, key):
            continue
        if isinstance(value, dict):
            for name, each in value.items():
                words += [option.removesuffix("s"), f"{name}={each if isinstance(each, str) else json.dumps(each)}"]
        else:
            words += [option] if value is True else [option, str(value)]
    return words
