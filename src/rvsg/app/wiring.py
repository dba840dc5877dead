"""Parts of a campaign, made from its settings. Everything is checked here, before anything is written."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from rvsg.app.settings import BUDGETS, VLM_OPTIONS, CampaignConfig
from rvsg.core import plugins
from rvsg.core.errors import InputError
from rvsg.core.plugins import Spec
from rvsg.evaluation.metrics import METRICS
from rvsg.evaluation.signals import doubts_of
from rvsg.evaluation.verdict import Procedure, load_requirement
from rvsg.findings.feedback import StoredFeedback, rehearsing
from rvsg.generation.generator import Abilities, Generator, InformedGenerator
from rvsg.robots.robot import Robot
from rvsg.runs.attempt import Plan, SearchSettings
from rvsg.runs.ledger import CachedLedger
from rvsg.runs.runner import Evaluator, Executor, Runner
from rvsg.scenario.builder import check_mission, check_route, mission_of, read_scenario
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Mission, Scenario
from rvsg.scenario.world_lookup import doors_in, load_moved, load_world, world_of
from rvsg.search.abilities import abilities_of
from rvsg.search.execution import Limits, Parts
from rvsg.search.strategies import Strategy
from rvsg.simulation.simulators import Simulator, make_simulator
from rvsg.simulation.stacks.protocol import NavigationStack
from rvsg.store.knowledge_base import read_remembered
from rvsg.world.world import Route, World

STUDIED = ("heuristic", "random")
"""Generators whose people turn round at once in the study's profile, as the study's people did."""
COPY, ABILITIES = "knowledge.json", "abilities.json"
"""Copies in the folder of a campaign, which a resumed campaign reads: earlier scenarios, what its robot can do."""


@dataclass(frozen=True, kw_only=True)
class Wired:
    """A campaign that can begin: its plan and its parts, checked."""

    config: CampaignConfig
    plan: Plan
    world: World
    generator: Generator
    simulator: Simulator
    strategy_class: type[Strategy]
    executor: Executor | None
    notes: tuple[str, ...] = ()
    """What of the route was fitted to the robot, and what is doubtful of a requirement, in words."""
    own_simulator: bool = True
    """Whether the simulator was made for this campaign, which then closes it."""

    @property
    def simulator_spec(self) -> Spec:
        """The simulator with its effective options."""
        return Spec(self.simulator.name, self.simulator.options)

    @property
    def strategy_spec(self) -> Spec:
        """The strategy with the options that tell its present form from earlier ones."""
        return Spec(self.config.strategy, self.strategy_class.recorded)

    @property
    def plugins(self) -> dict[str, str]:
        """Distribution, version and content of every plug-in that does not ship; the stack's are in its version."""
        generator, asked = self.generator, (self.plan.requirement, *self.plan.also)
        used = {
            "generator": generator.generator if isinstance(generator, InformedGenerator) else generator,
            "strategy": self.strategy_class,
            "simulator": self.simulator,
            **{f"metric {judged.metric}": METRICS[judged.metric].of for judged in asked if judged.metric is not None},
        }
        return {what: content for what, plugin in used.items() if (content := plugins.content_of(plugin))}

    def strategy(self, ledger: CachedLedger, plan: Plan | None = None, recorded: Spec | None = None) -> Strategy:
        """Return a new strategy that reads its feedback from the ledger.

        Args:
            recorded: What the record of a stored campaign says of it, so that the campaign goes on as it began.
        """
        plan, make = plan or self.plan, cast(Callable[..., Strategy], self.strategy_class)
        same = recorded is not None and recorded.name == self.config.strategy
        options = recorded.options if recorded is not None and same else {}
        return make(plan, StoredFeedback(ledger, plan, self.world), self.world, **options)

    def runner(
        self, ledger: CachedLedger, tell: Callable[[str], None], *, jobs: int, executor: Executor | None
    ) -> Runner:
        """Return what makes the runs; those the ledger holds are not made again."""
        return Runner(
            self.simulator,
            self.world,
            measuring=Evaluator(self.plan.requirement, self.world, least_realism=self.plan.realism),
            jobs=jobs,
            ledger=ledger,
            executor=executor or self.executor,
            notify=tell,
            closes=self.own_simulator,
        )

    def parts(
        self, plan: Plan, judging: Procedure, ledger: CachedLedger, runner: Runner, cancelled: Callable[[], bool]
    ) -> Parts:
        """Return what the loop works with."""
        measuring = Evaluator(
            plan.requirement, self.world, procedure=judging, time_limit_s=plan.mission.route.time_limit_s
        )
        config = self.config
        limits = Limits(calls=config.budget_calls, tokens=config.budget_tokens, usd=config.budget_usd)
        return Parts(
            generator=self.generator,
            runner=runner,
            judge=measuring.judge,
            ledger=ledger,
            procedure=judging,
            cancelled=cancelled,
            limits=Limits() if config.replay is not None else limits,  # a replay costs nothing
            alone=True,
            search_anyway=config.search_anyway,
            shrink_runs=config.shrink_runs,
        )


def wire(
    config: CampaignConfig,
    *,
    generator: Generator | None = None,
    simulator: Simulator | None = None,
    stack: NavigationStack | None = None,
) -> Wired:
    """Look everything up and make it.

    Args:
        generator, simulator, stack: instances to use instead of the plug-ins that the settings name.

    Raises:
        InputError: the first thing that cannot be used.
    """
    start = read_scenario(Path(config.start_from))[0] if config.start_from is not None else None
    world, route = _route_of(config, start)
    strategy = strategy_class(config)
    plugins.check_complete("strategy", strategy, Strategy)
    own = simulator is None
    simulator = make_simulator(simulator or config.simulator_spec, stack or config.stack_spec())
    mission, notes = mission_of(world, route, _robot_of(config, start), simulator.robots)
    if start is not None:
        mission = mission.replace(driven=start.mission.driven)
    check_mission(mission, world)
    requirement = load_requirement(config.requirement, mission.route)
    also = also_of(config, requirement, mission, several=strategy.needs_several)
    if start is not None and generator is None:
        generator = _near(config, start)
    generator = _generator_of(config, generator, simulator, world, requirement)
    plugins.check_options("store", config.store, config.store_options, given=1)
    values = {
        "name": f"{world.name}-{route.name}-{requirement.name}-{config.generator_name}-{config.strategy}-{config.seed}",
        "mission": mission,
        "requirement": requirement,
        "also": also,
        "scenarios": scenarios_of(config),
        "proposals": proposals_of(config) if generator.asks_a_model else None,
    }
    return Wired(
        config=config,
        plan=Plan(**{key: getattr(config, key) for key in SearchSettings.model_fields} | values),
        world=world,
        generator=generator,
        simulator=simulator,
        strategy_class=strategy,
        executor=executor_of(config),
        notes=(*notes, *(doubt for judged in (requirement, *also) for doubt in doubts_of(judged, mission, world))),
        own_simulator=own,
    )


def strategy_class(config: CampaignConfig) -> type[Strategy]:
    """Return the class of the strategy that is named."""
    strategy: type[Strategy] = plugins.find("strategy", config.strategy)
    return strategy


def _route_of(config: CampaignConfig, start: Scenario | None) -> tuple[World, Route]:
    """Return the world, with objects and doors as asked, and the route in it; by its name that of the scenario."""
    world = load_world(config.world)
    if start is not None:
        world = world_of(start.mission, world)
    if config.moved is not None:
        world = world.with_moved(load_moved(config.moved, world))
    world = doors_in(world, config.doors)
    same = start is not None and start.mission.route.name == config.route
    route = start.mission.route if start is not None and same else world.route(config.route)
    check_route(route, world)
    return world, route


def _robot_of(config: CampaignConfig, start: Scenario | None) -> str | Robot:
    """Return the robot that is named; by its name that of the scenario."""
    robot = start.mission.robot if start is not None else None
    return robot if isinstance(robot, Robot) and robot.name == config.robot else config.robot


def _near(config: CampaignConfig, start: Scenario) -> Generator:
    """Return the generator of scenarios near the one to start from."""
    from rvsg.generation.near import NearGenerator

    if config.generator is not None:
        raise InputError(
            f"--from makes its scenarios of the one given, so --generator {config.generator} has nothing to do. "
            "Leave one of the two out."
        )
    if config.humans < len(start.people.humans):
        count = len(start.people.humans)
        raise InputError(f"The scenario of --from has {count} people, and --humans asks for {config.humans}.")
    return NearGenerator(start, config.near)


def _generator_of(
    config: CampaignConfig, given: Generator | None, simulator: Simulator, world: World, requirement: Requirement
) -> Generator:
    """Return the generator that is given or named, with what it may rehearse in and what it should remember."""
    generator = given
    if generator is None:
        options = generator_options(config)
        if simulator.options.get("profile") == "published-study" and config.generator_name in STUDIED:
            options = {"works": False, **options}
        generator = plugins.make("generator", config.generator_name, options)
    plugins.check_complete("generator", generator, Generator)
    let_rehearse(generator, simulator, world, seed=config.seed, requirement=requirement, kept=config.folder / ABILITIES)
    if config.knowledge is None:
        return generator
    return InformedGenerator(generator, read_remembered(remembered_file(config)))


def also_of(config: CampaignConfig, first: Requirement, mission: Mission, *, several: bool) -> tuple[Requirement, ...]:
    """Return the further requirements of a campaign.

    Args:
        several: Whether the strategy needs them.

    Raises:
        InputError: There are none where they are needed, two have one name, or one has no metric or no limit.
    """
    also = tuple(load_requirement(name, mission.route) for name in config.also)
    if several and not also:
        raise InputError(f"The strategy {config.strategy} needs several requirements: add --also R2, for example.")
    names = [judged.name for judged in (first, *also)]
    if twice := next((name for name in names if names.count(name) > 1), None):
        raise InputError(f"--also: {twice} is given twice. Give every requirement once.")
    for judged in also:
        if judged.metric is None:
            raise InputError(f"--also {judged.name}: only requirements with a metric can be added, not formulas.")
    for judged in (first, *also) if also else ():
        if not judged.threshold:
            raise InputError(f"{judged.name} has no limit other than 0, so it cannot be weighed against others.")
    return also


def let_rehearse(
    generator: Generator,
    simulator: Simulator,
    world: World,
    *,
    seed: int,
    requirement: Requirement | None = None,
    kept: Path | None = None,
) -> None:
    """Let a generator that rehearses its answers do so in this simulator, measured by a requirement.

    Args:
        kept: The file that keeps what the robot can do. Only the embedded simulator is fast enough to measure that.
    """

    def measure(mission: Mission) -> Abilities | None:
        return abilities_of(mission, simulator, kept) if simulator.name == "embedded" else None

    generator.allow_rehearsals(rehearsing(simulator, world, seed=seed, requirement=requirement, measure=measure))


def remembered_file(config: CampaignConfig) -> Path:
    """Return the file of earlier scenarios: the copy in the folder of a campaign that was begun, else the one given."""
    copied = config.folder / COPY
    return copied if copied.is_file() else Path(config.knowledge or "")


def scenarios_of(config: CampaignConfig) -> int:
    """Return the number of scenarios: as asked, or as many more as the budget in runs pays for."""
    if config.budget_runs is None:
        return config.scenarios
    return max(config.scenarios, math.ceil(config.budget_runs / (config.repeats * (1 + config.refinements))))


def proposals_of(config: CampaignConfig) -> int:
    """Return how often a model is asked for a proposal, however many runs there are."""
    return config.scenarios * (1 + config.refinements)


def executor_of(config: CampaignConfig) -> Executor | None:
    """Return what makes the runs outside this process; None for worker processes on this machine."""
    if config.executor == "processes":
        if config.executor_options:
            raise InputError('The executor "processes" takes no options; --jobs is the number of processes.')
        return None
    executor: Executor = plugins.make("executor", config.executor, config.executor_options)
    return executor


def generator_options(config: CampaignConfig) -> dict[str, Any]:
    """Return the options the generator is made with; for `vlm` also how the model is reached, and its budget."""
    if config.generator_name != "vlm":
        return dict(config.generator_options)
    options = {name: getattr(config, name) for name in (*VLM_OPTIONS, *BUDGETS) if getattr(config, name) is not None}
    return {"folder": str(config.folder), **options, **config.generator_options}


def jobs_of(config: CampaignConfig) -> int:
    """Return the number of worker processes: as set, or one per core available to this process."""
    if config.jobs:
        return config.jobs
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:
        return os.cpu_count() or 1
