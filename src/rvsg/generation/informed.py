"""A generator that also gets scenarios from other campaigns."""

from __future__ import annotations

from collections.abc import Sequence

from rvsg.generation.generator import Generator, Proposal
from rvsg.generation.rehearsal import Rehearse
from rvsg.generation.vlm.watching import Tell
from rvsg.scenario.brief import Brief, Remembered
from rvsg.world.world import World


class InformedGenerator(Generator):
    """Adds earlier scenarios to the memory of every brief for a new one, and lets another generator answer it.

    Those of another route are left out: a generator compares scenarios of one drive. An unguided brief stays unguided.
    """

    def __init__(self, generator: Generator, earlier: Sequence[Remembered]) -> None:
        self.generator = generator
        self.earlier = tuple(earlier)

    @property
    def name(self) -> str:
        """The name of the generator that answers."""
        return self.generator.name

    @property
    def asks_a_model(self) -> bool:
        """Whether that generator does."""
        return self.generator.asks_a_model

    @property
    def notes(self) -> tuple[str, ...]:
        """What that generator has to say."""
        return self.generator.notes

    def watch(self, tell: Tell | None) -> None:
        """Tell of its calls of a model."""
        self.generator.watch(tell)

    def allow_rehearsals(self, rehearse: Rehearse) -> None:
        """Let that generator rehearse."""
        self.generator.allow_rehearsals(rehearse)

    def propose(self, brief: Brief, world: World) -> Proposal:
        """Answer the brief with what is known from elsewhere in its memory, the oldest first."""
        if brief.kind != "new" or brief.requirement is None:
            return self.generator.propose(brief, world)
        route = brief.mission.route
        fitting = tuple(each for each in self.earlier if each.scenario.mission.route.name == route.name)
        return self.generator.propose(brief.replace(memory=(*fitting, *brief.memory)), world)

    def close(self) -> None:
        """Release what that generator holds."""
        self.generator.close()
