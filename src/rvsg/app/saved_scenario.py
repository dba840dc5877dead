"""A saved scenario as a run again: with what it was found with, unless somebody says otherwise.

Every verb, tool and job that simulates the scenario of a file gets it here, with what runs it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

from rvsg.core.plugins import Spec, ignore
from rvsg.evaluation.verdict import load_requirement
from rvsg.scenario.builder import FoundWith, changed, check_valid, load_family, load_saved, scenario_json
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Scenario
from rvsg.scenario.variation import ScenarioFamily
from rvsg.simulation.simulators import as_found, by_content, check_robot, make_simulator, stack_in_words, with_stack
from rvsg.simulation.stacks.stack_choice import StackLike, default_stack
from rvsg.world.world import World

AS_FOUND: Mapping[str, Any] = MappingProxyType({})


@dataclass(frozen=True, kw_only=True)
class Rerun:
    """A scenario, its world, and what runs and judges it."""

    scenario: Scenario
    world: World
    simulator: Spec
    """With its stack."""
    requirement: Requirement | str
    found: FoundWith
    """The same by content."""
    family: ScenarioFamily | None = None
    """The scenarios of its ranges, where these are asked for."""

    def json(self, scenario: Scenario) -> str:
        """Return a scenario that was made of it as JSON, with what it was found with."""
        return scenario_json(scenario, self.found.replace(requirement=load_requirement(self.requirement)))


def rerun(
    path: str | Path,
    given: Mapping[str, Any] = AS_FOUND,
    *,
    requirement: str | None = None,
    world: str | None = None,
    vary: Sequence[str] | None = None,
    on_message: Callable[[str], None] = ignore,
) -> Rerun:
    """Return the scenario of a file, checked, with what it runs with; say what that is.

    Args:
        given: settings that replace what it was found with: simulator, stack, their options, robot, moved, doors.
        requirement: instead of the one it was found with, else R1.
        vary: ranges besides those of the file, see `load_family`; None where it holds none.

    Raises:
        FileError: a file is wrong.
        InputError: the simulator or the stack cannot be made; code that only the file names is refused.
        InvalidScenario: the scenario breaks a rule.
    """
    family = None
    if vary is None:
        scenario, place, kept = load_saved(path, world)
    else:
        family, place, kept = load_family(path, vary, world)
        scenario = family.middle
    moved = Path(given["moved"]) if given.get("moved") else None
    scenario, place, notes = changed(scenario, place, robot=given.get("robot"), moved=moved, doors=given.get("doors"))
    doubts = check_valid(scenario, place) if family is None else ()  # of ranges, each point is checked
    for note in (*notes, *(f"warning: {doubtful}" for doubtful in doubts)):
        on_message(note)
    simulator = _simulator(kept.simulator, given)
    with closing(make_simulator(simulator)) as ready:
        check_robot(scenario, ready)
        used = by_content(simulator, ready.options)
    on_message(f"{scenario.mission.robot_name} with {stack_in_words(used)}, {used.name}.")
    if kept.simulator is not None and (was := stack_in_words(kept.simulator)) != stack_in_words(used):
        on_message(f"It was found with {was}.")
    file = stack_file(given["stack"]) if "stack" in given else kept.stack_file
    return Rerun(
        scenario=scenario,
        world=place,
        simulator=simulator,
        requirement=requirement or kept.requirement or "R1",
        found=FoundWith(simulator=used, stack_file=file),
        family=None if family is None else family.replace(middle=scenario),
    )


def stack_file(stack: StackLike | None) -> str | None:
    """Return the path of the parameter file that a stack is given as; None of another one."""
    name = stack.name if isinstance(stack, Spec) else str(stack)
    return str(Path(name).absolute()) if name.endswith((".yaml", ".yml")) else None


def _simulator(kept: Spec | None, given: Mapping[str, Any]) -> Spec:
    """Return the simulator with its stack: what is given, and for the rest as it was found."""
    own = Spec(given.get("simulator") or (kept or Spec("embedded")).name, given.get("simulator_options"))
    chosen = as_found(kept, own, given.get("stack"))
    assert isinstance(chosen, Spec)
    options, known = given.get("stack_options") or {}, chosen.options.get("stack")
    if "stack" in given:
        return with_stack(chosen, Spec(given["stack"], options))
    if options and isinstance(known, Mapping):
        return with_stack(chosen, Spec(known["name"], {**known["options"], **options}))
    return with_stack(chosen, Spec(default_stack(chosen.options.get("profile")), options) if options else None)
