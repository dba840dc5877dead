"""What every Generator must do. Plug-in writers run `check_generator(MyGenerator(), briefs, world)` in their tests."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from rvsg.core.errors import GenerationError
from rvsg.generation.generator import Generator, Proposal
from rvsg.scenario.brief import Brief, Feedback, Remembered
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Human, HumanConfiguration, Mission, Task
from rvsg.scenario.validity import check
from rvsg.world.world import World

DISTANCE = Requirement(name="D", title="Distance", text="The robot keeps a safe distance.", metric="dto", unit="m")
SMOOTH = Requirement(
    name="S", title="Stability", text="The robot keeps operational stability.", metric="jerk", worse="larger"
)
TIMELY = Requirement(
    name="T", title="Efficiency", text="The task completes within a reasonable time.", metric="trg", worse="larger"
)


def check_generator(generator: Generator, briefs: Iterable[Brief], world: World, *, repeatable: bool = True) -> None:
    """Raises AssertionError naming the first thing a generator does that none may do.

    Equal briefs give equal proposals (unless not `repeatable`: an outside model answers); a proposal is valid or
    says why it is not; it is of the mission that was asked; a brief is not changed; only a GenerationError may be
    raised, and a repeatable generator raises none.
    """
    assert generator.name and generator.name == generator.name.strip(), "a generator has a name"
    for brief in briefs:
        before = brief.to_json()
        proposal = _proposed(generator, brief, world, repeatable)
        if proposal is None:
            continue
        assert brief.to_json() == before, f"{generator.name} changed the brief it was given"
        if repeatable:
            again = generator.propose(brief, world)
            assert again.id == proposal.id, f"{generator.name} answered an equal brief differently: seed {brief.seed}"
        for complaint in complaints(proposal, brief, world):
            raise AssertionError(f"{generator.name}, brief {brief.kind} with seed {brief.seed}: {complaint}")


def _proposed(generator: Generator, brief: Brief, world: World, repeatable: bool) -> Proposal | None:
    try:
        return generator.propose(brief, world)
    except GenerationError as error:
        assert not repeatable, f"{generator.name} could not answer: {error}"
        return None


def complaints(proposal: Proposal, brief: Brief, world: World) -> Iterator[str]:
    """What is wrong with a proposal."""
    if not proposal.generator:
        yield "the proposal does not name its generator"
    if proposal.scenario is None:
        if not proposal.problems:
            yield "there is no scenario, and nothing says why"
        return
    if proposal.problems:
        yield "there is a scenario, and problems are left"
    if proposal.scenario.mission != brief.mission:
        yield "the scenario is of another mission than was asked for"
    found = check(proposal.scenario.people, brief.mission, world)
    if found:
        yield f"the scenario is not valid: {found[0]}"
    if len(proposal.scenario.people.humans) != brief.humans:
        yield f"{brief.humans} humans were asked for, {len(proposal.scenario.people.humans)} came"
    if Proposal.from_json(proposal.to_json()).id != proposal.id:
        yield "the proposal does not survive being written and read"


def odd_briefs(generator: Generator, mission: Mission, world: World) -> tuple[Brief, ...]:
    """Briefs as a campaign makes them, and odd ones.

    Unguided, crowded, a refinement without feedback, with feedback that holds nothing but a mean, with feedback on
    people of another world, and a memory that repeats itself. The refinements refine the generator's own scenario.
    """
    plain = Brief(mission=mission, requirement=DISTANCE, seed=1)
    briefs = [
        plain,
        plain.replace(requirement=None),
        plain.replace(requirement=SMOOTH, humans=1),
        plain.replace(requirement=TIMELY, humans=5, seed=2**63),
        plain.replace(kind="refine"),
    ]
    first = generator.propose(plain, world).scenario
    if first is not None:
        feedback = Feedback(scenario=first, objectives=(1.0,), mean=1.0, interval=(1.0, 1.0), previous_mean=0.5)
        memory = Remembered(description="", tasks={"Nobody": ("A → B",)}, mean=1.0, interval=(0.5, 1.5), scenario=first)
        elsewhere = Task(name="Nowhere → Nowhere", path=("Q0", "", "Q1"))
        strangers = HumanConfiguration(humans=(Human(name="Stranger", tasks=(elsewhere, Task(name="idle", path=()))),))
        strange = feedback.replace(scenario=first.replace(people=strangers))
        briefs += [
            plain.replace(kind="refine", feedback=strange),
            plain.replace(kind="refine", feedback=feedback, configuration_index=1),
            plain.replace(kind="refine", feedback=feedback, requirement=None),
            plain.replace(memory=(memory, memory), scenario_index=2),
        ]
    return tuple(briefs)
