"""Briefs as a campaign makes them, and odd ones, for the tests of generators."""

from __future__ import annotations

from rvsg.generation.generator import Generator
from rvsg.scenario.brief import Brief, Feedback, Remembered
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Human, HumanConfiguration, Mission, Task
from rvsg.world.world import World

DISTANCE = Requirement(name="D", title="Distance", text="The robot keeps a safe distance.", metric="dto", unit="m")
SMOOTH = Requirement(
    name="S", title="Stability", text="The robot keeps operational stability.", metric="jerk", worse="larger"
)
TIMELY = Requirement(
    name="T", title="Efficiency", text="The task completes within a reasonable time.", metric="trg", worse="larger"
)


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
