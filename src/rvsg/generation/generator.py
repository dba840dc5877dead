"""The Generator protocol, its answer (the Proposal), and the rehearsals a generator may ask for before it answers."""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Protocol

import numpy as np
from pydantic import Field, model_validator

from rvsg.core.documents import record_of
from rvsg.core.inputs import parse_json, read_text
from rvsg.core.records import Record
from rvsg.generation.vlm.access import Tell
from rvsg.scenario.brief import Arrival, Brief, Remembered, Row, Stop, TuningLimits
from rvsg.scenario.builder import WORLD_FOLDER, with_world_folder
from rvsg.scenario.rules import Finding, Repair
from rvsg.scenario.scenario import HumanConfiguration, Mission, Scenario
from rvsg.scenario.world_lookup import folder_of
from rvsg.world.world import World

LATE_S = 2.0
"""A planned time that is off by less is good enough."""
NEAR_M = 4.0
"""Somebody who never comes nearer to the robot than this (centre to centre) takes no part in the test."""
MET_M = 2.0
"""From the first moment at which somebody is this near (centre to centre), what happens is the encounter's effect."""


class Walked(Record):
    """What one person does in a rehearsal: first arrivals, where they get stuck, how near they come to the robot."""

    begins_at: str = ""
    """The first waypoint."""
    left_s: float | None = None
    """When the person leaves it, in seconds; None: never."""
    arrivals: tuple[Arrival, ...] = ()
    stuck_at: str | None = None
    stuck_s: float | None = None
    """Since when the person stands still until the run ends, in seconds; None for who walks on."""
    stood: tuple[tuple[float, float, str], ...] = ()
    """From when to when, in seconds, and where somebody who should walk stands still, and then walks on."""
    nearest_m: float
    nearest_s: float
    met_s: float | None = None
    """When the person is first within `MET_M` of the robot, in seconds; None: never."""
    reacted_s: Annotated[float | None, Field(exclude_if=lambda time: time is None)] = None
    """When the person first reacts to the robot, in seconds; None: never."""


class Abilities(Record):
    """What a robot with its stack did in an empty hall: distances in metres, and counts of runs."""

    setting: str
    """Id of the robot, the simulator and its options."""
    gap_m: float | None
    """The narrowest gap that it drove through; None: through none that was tried."""
    blocked_m: float | None
    """The widest gap that it did not drive through; None: it drove through all."""
    walker_m: float | None
    """The usual smallest distance of centres from somebody who walks towards it, and from somebody who stands."""
    stander_m: float | None
    touching: int
    """Of the runs in which it `met` somebody in the open hall, those in which it moved into them."""
    met: int
    blocked: int
    """Runs with somebody who stands on the goal, and as many with somebody who stands in a doorway."""
    arriving: int
    """Of those with somebody on the goal, those in which it arrived, and in which it moved into them."""
    pushing: int
    doorway_m: float
    """The width of that doorway, in which robot and person do not fit side by side."""
    passing: int
    """The runs in which it came through the doorway."""
    gives_up_s: float | None
    """When its navigation usually gave up before the doorway; None: never."""
    recoveries: tuple[str, ...] = ()
    """What its navigation did to recover in the blocked runs."""


class Rehearsal(Record):
    """One simulated run in short: where the robot is every two seconds, when it arrives, and what the people do."""

    robot: tuple[tuple[float, str], ...]
    arrival_s: float | None
    way: tuple[tuple[float, float, float], ...] = ()
    """Where the robot is every half second: seconds, metres, metres."""
    people: dict[str, Walked] = Field(default_factory=dict)
    rows: tuple[Row, ...] = ()
    """What everybody does every two seconds; empty without people."""
    stops: Annotated[tuple[Stop, ...], Field(exclude_if=lambda stops: not stops)] = ()
    """Where the robot stands among people, and why."""
    value: Annotated[float | None, Field(exclude_if=lambda value: value is None)] = None
    """The value of the requirement; None: not measured, or the run has none."""
    capped: Annotated[bool, Field(exclude_if=lambda capped: not capped)] = False
    """Whether the time limit sets the value."""
    abilities: Annotated[Abilities | None, Field(exclude_if=lambda abilities: abilities is None)] = None
    """What the robot can do; only the drive without people tells it."""


Rehearse = Callable[[Mission, HumanConfiguration], Rehearsal]
"""Simulate a configuration once and return it in short. Without humans it is the undisturbed drive."""

Plan = Mapping[str, Mapping[str, float]]
"""When each person is planned to be at which waypoint, in seconds: name, waypoint, time."""


def surprises(rehearsal: Rehearsal, plan: Plan) -> tuple[str, ...]:
    """Return what does not happen as planned: who is held up, who never comes near, who arrives at another time.

    Only what goes wrong before the first person meets the robot is a mistake of the plan; afterwards robot and people
    hold each other up, which is what the test is for. Somebody who reacts to the robot no longer walks as planned.
    """
    met = min((walked.met_s for walked in rehearsal.people.values() if walked.met_s is not None), default=math.inf)
    held_up = math.isfinite(met) and rehearsal.arrival_s is None
    found = []
    for name, walked in rehearsal.people.items():
        stuck = walked.stuck_s
        left, reacted = (math.inf if time is None else time for time in (walked.left_s, walked.reacted_s))
        if stuck is not None and stuck < met:
            found.append(f"{name} gets stuck at {walked.stuck_at} from {stuck:g} s on and does not walk further.")
        for start, end, at in walked.stood:
            if start < met:
                held = f"{name} stands still at {at} from {start:g} to {end:g} s"
                found.append(f"{held}, held up by what is in the way.")
        if walked.nearest_m > NEAR_M and not held_up:
            nearest = f"the smallest distance is {walked.nearest_m:.1f} m, at {walked.nearest_s:.0f} s"
            found.append(f"{name} never comes near the robot: {nearest}.")
        reached = {arrival.at: arrival.time_s for arrival in reversed(walked.arrivals)}
        for at, planned in plan.get(name, {}).items():
            if at == walked.begins_at and planned < left + LATE_S:
                continue  # there from the start on
            actual = reached.get(at, math.inf)
            if min(planned, actual) >= min(met, reacted) or abs(actual - planned) < LATE_S:
                continue
            if math.isfinite(actual):
                what = f"reaches {at} at {actual:.1f} s"
            elif at == walked.begins_at:
                what = f"leaves {at} at {left:.1f} s and does not come back"
            else:
                what = f"does not reach {at} during the run"
            found.append(f"{name} {what}; you planned {planned:g} s.")
    return tuple(found)


class Call(Record):
    """One call of a model, as it is kept: what it was for, what it cost, and the key of its recording.

    `estimated` where the service did not count the tokens itself.
    """

    purpose: str
    model: str
    input_tokens: int = 0
    cached_tokens: int = 0
    output_tokens: int = 0
    cost_usd: float | None = None
    latency_s: float = 0.0
    recording: str | None = None
    error: str | None = None
    estimated: bool = False


class Proposal(Record):
    """A generator's answer. `scenario` is None where nothing valid came of it; the problems say why.

    `first_findings` are what the checker said of the very first answer, `problems` what was left at the end,
    `repairs` what was changed to make it valid.
    """

    generator: str
    scenario: Scenario | None
    reasoning: str = ""
    lesson: str = ""
    """What the generator learnt from the measurements so far, in one to three sentences; empty where it says nothing.
    The next scenarios are told of it."""
    plan: dict[str, dict[str, float]] = Field(default_factory=dict)
    """When the generator means each person to reach which waypoint, in seconds: name, waypoint, time."""
    limits: TuningLimits = Field(default_factory=dict)
    """What an optimiser may change of the configuration."""
    first_findings: tuple[Finding, ...] = ()
    problems: tuple[Finding, ...] = ()
    repairs: tuple[Repair, ...] = ()
    corrections: int = 0
    calls: tuple[Call, ...] = ()
    rehearsals: Annotated[tuple[tuple[Scenario, float], ...], Field(exclude_if=lambda rehearsals: not rehearsals)] = ()
    """Scenarios that were simulated once on the way to this one, this one among them, and their values."""
    extra: dict[str, Any] = Field(default_factory=dict)

    @model_validator(mode="before")
    @classmethod
    def _of_the_mission(cls, values: Any) -> Any:
        """Read rehearsals that are stored as people alone: they were of the mission of the scenario."""
        if not isinstance(values, dict) or not values.get("rehearsals") or not isinstance(values.get("scenario"), dict):
            return values
        mission = values["scenario"].get("mission")
        read = [({"mission": mission, "people": e} if "humans" in e else e, v) for e, v in values["rehearsals"]]
        return values | {"rehearsals": read}


class Generator(Protocol):
    """Anything that answers a Brief: an equal brief (its seed included) gives an equal proposal.

    An outside model's answers are recorded instead. Derive a generator from this class: everything but `name` and
    `propose` has a default.
    """

    @property
    def name(self) -> str:
        """The registered name."""
        ...

    @property
    def notes(self) -> tuple[str, ...]:
        """What a person should know after the last proposal, e.g. where a replay diverged from its record."""
        return ()

    @property
    def asks_a_model(self) -> bool:
        """Whether a proposal costs calls of a model, so that a strategy should ask for few of them."""
        return False

    def watch(self, tell: Tell | None) -> None:
        """Tell of every call of a model while it is made; None ends it. Without a model there is nothing to tell."""
        return

    def allow_rehearsals(self, rehearse: Rehearse) -> None:
        """Accept a function that simulates a configuration once, for generators that try an answer before giving it."""
        return

    def propose(self, brief: Brief, world: World) -> Proposal:
        """Answer the brief; a bad answer is a Proposal with problems, only a missing one is a GenerationError."""
        ...

    def close(self) -> None:
        """Release every resource. May be called again."""
        return


class InformedGenerator(Generator):
    """Another generator, whose briefs for a new scenario remember earlier ones of the same route, unless unguided."""

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


def rng_of(brief: Brief, name: str) -> np.random.Generator:
    """The random numbers of a generator for a brief: of its seed, its place in the campaign and the name."""
    key = (zlib.crc32(name.encode()), brief.scenario_index, brief.configuration_index)
    return np.random.default_rng(np.random.SeedSequence(entropy=brief.seed, spawn_key=key))


def read_proposal(path: Path) -> Proposal:
    """Return a proposal from its file; FileError names everything that is wrong."""
    value = parse_json(read_text(path), path)
    if isinstance(value, dict):
        value.pop(WORLD_FOLDER, None)
    return record_of(path, value, Proposal)


def proposal_json(proposal: Proposal) -> str:
    """Return a proposal as JSON, with the folder of its world beside it where that is not a shipped one."""
    scenario = proposal.scenario
    folder = folder_of(scenario.mission.world_id) if scenario is not None else None
    return with_world_folder(proposal.to_json(), folder)
