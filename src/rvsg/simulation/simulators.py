"""Simulators by name, by Spec or as instances."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, contextmanager, nullcontext
from pathlib import Path
from typing import Protocol

from rvsg.core import plugins
from rvsg.core.errors import InputError, UnknownName
from rvsg.core.plugins import Spec, ignore
from rvsg.core.records import content_id
from rvsg.robots.robot import Robot
from rvsg.scenario.scenario import ROBOT, Mission, Scenario
from rvsg.simulation.run import Run
from rvsg.simulation.stacks.stack_choice import STUDY_STACK, StackLike, stack_class, stack_names
from rvsg.world.world import World


class Simulator(Protocol):
    """Anything that runs scenarios. Equal scenario, world, seed and options give an equal run, bit for bit.

    Derive a simulator from this class: `robots`, `any_robot`, `prepare` and `close` have defaults. A simulator
    reaches worker processes by pickling, before or after `prepare`.
    """

    @property
    def name(self) -> str:
        """The registered name, e.g. `embedded`."""
        ...

    @property
    def options(self) -> Mapping[str, object]:
        """The effective options as JSON-able data (a version among them), equal to `options` of every Run.

        With the scenario and the seed they are the run's content id, so that a known run is not simulated again.
        """
        ...

    @property
    def robots(self) -> tuple[str, ...]:
        """The names of the robots it simulates."""
        return (ROBOT,)

    @property
    def any_robot(self) -> bool:
        """Whether it also simulates every robot that a scenario holds as a record."""
        return False

    def notes(self, robot: Robot) -> tuple[str, ...]:
        """Return what a user has to know who simulates this robot."""
        return ()

    def prepare(self, tell: Callable[[str], None]) -> None:
        """Do once what takes long, e.g. compile or connect; `tell` takes messages for people. May be called again."""
        return

    def run(self, scenario: Scenario, world: World, *, seed: int) -> Run:
        """Simulate one episode. Bad starts and unreachable goals are an Outcome, never an exception or a hang."""
        ...

    def close(self) -> None:
        """Release what `prepare` or `run` acquired. May be called again.

        Who makes a simulator or a stack closes it: functions of RVSG leave open what they are given as an instance.
        """
        return


def make_simulator(simulator: str | Spec | Simulator, stack: StackLike | None = None) -> Simulator:
    """Return a simulator given by name, by Spec or by itself.

    Args:
        stack: the navigation stack under test, for a simulator that is given by name or Spec.
    """
    if isinstance(simulator, str | Spec):
        spec = with_stack(simulator, stack)
        instance: Simulator = plugins.make("simulator", spec.name, spec.options)
    elif stack is not None:
        raise InputError(f"The simulator {simulator.name} is given as an instance. Give it the stack when you make it.")
    else:
        instance = simulator
    plugins.check_complete("simulator", instance, Simulator)
    return instance


def with_stack(simulator: str | Spec, stack: StackLike | None) -> Spec:
    """Return a simulator's Spec with the stack under test among its options: as data, or as the object it is."""
    spec = Spec.of(simulator)
    if stack is None:
        return spec
    if isinstance(stack, Spec):
        stack = stack.model_dump(mode="json")
    return Spec(spec.name, {**spec.options, "stack": str(stack) if isinstance(stack, Path) else stack})


def as_found(
    kept: Spec | None, simulator: str | Spec | Simulator | None = None, stack: StackLike | None = None
) -> Spec | Simulator:
    """Return what runs a finding: what is given, with what it leaves open as the finding was found with it.

    A stack that is given is not in the result; one that was found is, in the version that is present.
    """
    kept = kept or Spec("embedded")
    if simulator is not None and not isinstance(simulator, str | Spec):
        return simulator
    given = kept if simulator is None else Spec.of(simulator)
    options = {**kept.options, **given.options} if given.name == kept.name else dict(given.options)
    if stack is not None:
        options.pop("stack", None)
    elif isinstance(known := options.get("stack"), Mapping):  # the version under test is the one that is present
        options["stack"] = {key: value for key, value in known.items() if key != "version"}
    return Spec(given.name, options)


@contextmanager
def simulator_of(
    simulator: str | Spec | Simulator,
    stack: StackLike | None = None,
    *,
    scenario: Scenario | None = None,
    on_message: Callable[[str], None] = ignore,
) -> Iterator[Simulator]:
    """Make a simulator and prepare it; on leaving, close it unless it was given as an instance.

    Args:
        scenario: refuse its robot before the simulator is prepared, where the simulator does not know it.
    """
    instance = make_simulator(simulator, stack)
    with nullcontext(instance) if instance is simulator else closing(instance):
        if scenario is not None:
            check_robot(scenario, instance)
        instance.prepare(on_message)
        if scenario is not None:
            tell_of_robot(scenario.mission, instance, on_message)
        yield instance


def by_content(spec: Spec, effective: Mapping[str, object]) -> Spec:
    """Return a simulator's Spec with the stack under test by content and version, from its effective options."""
    stack = effective.get("stack")
    if stack is None and spec.name == "embedded":
        stack = {"name": STUDY_STACK, "version": stack_class(STUDY_STACK).version, "options": {}}
    return spec if stack is None else Spec(spec.name, {**spec.options, "stack": stack})


def stack_in_words(spec: Spec) -> str:
    """Return the stack of a Spec that `by_content` made, with its version; the simulator's name without a stack."""
    stack = spec.options.get("stack")
    if not isinstance(stack, Mapping):
        return spec.name
    parameters = f" (parameters {content_id('stack', stack)[6:14]})" if stack.get("options") else ""
    return f"{stack['name']} {stack.get('version', '')}".strip() + parameters


def stack_name(spec: Spec) -> str:
    """Return the name of the stack under test; empty where the simulator knows none."""
    stack = spec.options.get("stack", {"name": STUDY_STACK} if spec.name == "embedded" else None)
    return str(stack.get("name", "")) if isinstance(stack, Mapping) else ""


def described(spec: Spec) -> str:
    """Return a simulator in words: its name, the stack under test, and whether its runs can be repeated."""
    name = stack_name(spec)
    stack = stack_class(name) if name in stack_names() else None
    repeatable = spec.options.get("repeatable", True) and (stack is None or stack.repeatable)
    words = f"{spec.name}, stack {name}" if name else spec.name
    return words if repeatable else f"{words} (not repeatable bit for bit: a seed is the number of a run)"


def check_robot(scenario: Scenario, simulator: Simulator) -> None:
    """Refuse a scenario whose robot the simulator does not know."""
    mission = scenario.mission
    if simulator.any_robot and mission.robot_record is not None:
        return
    if mission.robot_name not in simulator.robots or isinstance(mission.robot, Robot):
        hint = (
            f'The simulator "{simulator.name}" knows no other. Another robot needs a simulator of its own, '
            "a plug-in of the entry point group rvsg.simulators."
        )
        raise UnknownName("robot", mission.robot_name, simulator.robots, hint=hint)


def tell_of_robot(mission: Mission, simulator: Simulator, on_message: Callable[[str], None]) -> None:
    """Tell what a user has to know who simulates the robot of a mission."""
    if mission.robot_record is not None:
        for text in (*mission.robot_record.doubts, *simulator.notes(mission.robot_record)):
            on_message(text)
