"""The heuristic generator, the offline default: it plans people's work so that it meets the robot where it drives.

It draws ways of working between labelled areas, forecasts roughly who will be where when, and keeps what promises most
for the requirement. A refinement fits the forecast to what was measured and tries small changes; a new scenario avoids
the places and the work that the memory holds. People work by their tasks: nobody follows or waits for the robot.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from rvsg.generation.descriptions import Described, answer, describe_changed, describe_new, nowhere_to_walk, work_of
from rvsg.generation.forecast import AIMED, FINALISTS, Forecast, forecaster_of, promise
from rvsg.generation.generator import Generator, Proposal, rng_of
from rvsg.generation.people_sampler import (
    HEEDLESS_AIMS,
    UNDERWAY,
    PeopleSampler,
    Stop,
    added,
    cast,
    drawn,
    left_behind,
    shares_of,
)
from rvsg.generation.replies import LONGEST_DELAY_S
from rvsg.generation.workplaces import Place, follows, named_in, places_of, sentence, walking_graph
from rvsg.scenario.brief import Brief, Feedback
from rvsg.scenario.placement import spawn_finding, start_gap_m
from rvsg.scenario.requirement import Aim
from rvsg.scenario.rules import START_CLEARANCE_M
from rvsg.scenario.scenario import Behaviour, Human, HumanConfiguration, Pause, Task, at_places, ends_of
from rvsg.world.world import World

Change = Callable[[Human], tuple[Human, str] | None]

SPEEDS_M_S = (0.45, 1.6)


class _Changes:
    """Random changes of a person, after what the feedback says of them."""

    def __init__(self, work: PeopleSampler, feedback: Feedback) -> None:
        self.work, self.rng = work, work.rng
        self.idle = {name for influence in feedback.influences for name in influence.idle_waypoints}
        """Waypoints that never came near the robot."""
        changes: list[tuple[Change, float]] = [
            (self.delay, 3.0),
            (self.speed, 3.0),
            (self.pause, 2.0),
            (self.first, 1.5),
            (self.turned, 1.0),
            (self.moved, 2.0),
            (self.replaced, 1.0),
            (self.shortened, 1.0),
            (self.anew, 0.5),
        ]
        changes += [(self.longer, 3.0)] if work.works else []
        changes += [(self.elsewhere, 1.0)] if work.aim in UNDERWAY else []
        changes += [(self.heedless, 0.5)] if work.aim in HEEDLESS_AIMS else []
        self.changes = [change for change, _ in changes]
        self.shares = shares_of([weight for _, weight in changes])

    def once(self, human: Human) -> tuple[Human, str] | None:
        """One random change and its words; None where it is not possible for this person."""
        return self.changes[drawn(self.shares, self.rng)](human)

    def delay(self, human: Human) -> tuple[Human, str]:
        delay = round(min(LONGEST_DELAY_S, max(0.0, human.start_delay_s + float(self.rng.normal(0.0, 2.0)))), 1)
        return human.model_copy(update={"start_delay_s": delay}), f"sets off after {delay:g} s"

    def speed(self, human: Human) -> tuple[Human, str]:
        low, high = SPEEDS_M_S
        speed = round(min(high, max(low, human.speed_m_s * float(self.rng.lognormal(0.0, 0.15)))), 2)
        return human.model_copy(update={"speed_m_s": speed}), f"walks at {speed:g} m/s"

    def pause(self, human: Human) -> tuple[Human, str]:
        k = int(self.rng.integers(len(human.tasks)))
        task = human.tasks[k]
        if task.stops and self.rng.random() < 0.4:
            changed, words = task.model_copy(update={"pauses": ()}), f"no longer stops in {task.name}"
        else:
            at = self.work.pick(task.path, [2.718 ** -self.work.ground.along(n)[1] for n in task.path])
            pause = Pause(at=at, duration_s=round(float(self.rng.uniform(2.0, 12.0)), 1))
            changed = task.model_copy(update={"pauses": (pause,)})
            words = f"stops at {at} for {pause.duration_s:g} s"
        changed = changed.working(task.work)
        return human.model_copy(update={"tasks": (*human.tasks[:k], changed, *human.tasks[k + 1 :])}), words

    def longer(self, human: Human) -> tuple[Human, str] | None:
        k = int(self.rng.integers(len(human.tasks)))
        task, work = human.tasks[k], human.tasks[k].work
        activity = None if work is None else work.doing
        if work is None or activity is None:
            return None
        work = work.model_copy(update={"duration_s": activity.drawn_s(self.rng)})
        words = f"{activity.words} for {work.duration_s:g} s at {work.at}"
        return human.model_copy(update={"tasks": (*human.tasks[:k], task.working(work), *human.tasks[k + 1 :])}), words

    def first(self, human: Human) -> tuple[Human, str] | None:
        if len(human.tasks) < 2:
            return None
        by = int(self.rng.integers(1, len(human.tasks)))
        tasks = (*human.tasks[by:], *human.tasks[:by])
        return human.model_copy(update={"tasks": tasks}), f"begins with {tasks[0].name}"

    def turned(self, human: Human) -> tuple[Human, str] | None:
        if (stops := self._stops(human)) is None:
            return None
        turned = [stops[0], *reversed(stops[1:])] if len(stops) > 2 else stops[::-1]
        return self._rebuilt(human, turned, "goes round the other way")

    def moved(self, human: Human) -> tuple[Human, str] | None:
        if (stops := self._stops(human)) is None:
            return None
        k = int(self.rng.integers(len(stops)))
        others = {stops[k - 1].waypoint, stops[(k + 1) % len(stops)].waypoint, stops[k].waypoint}
        if (stop := self.work.at(stops[k].place, others)) is None:
            return None
        words = f"works {stop.place.name} from {stop.waypoint}"
        return self._rebuilt(human, [*stops[:k], stop, *stops[k + 1 :]], words)

    def replaced(self, human: Human) -> tuple[Human, str] | None:
        if (stops := self._stops(human)) is None:
            return None
        k = self._idle(stops)
        if (stop := self.work.stop(stops[:k] or stops[-1:], self.work.role())) is None:
            return None
        words = f"works {stop.place.name} instead of {stops[k].place.name}"
        return self._rebuilt(human, [*stops[:k], stop, *stops[k + 1 :]], words)

    def shortened(self, human: Human) -> tuple[Human, str] | None:
        stops = self._stops(human)
        if stops is None or len(stops) < 3:
            return None
        k = self._idle(stops)
        return self._rebuilt(human, stops[:k] + stops[k + 1 :], f"leaves {stops[k].place.name} out")

    def anew(self, human: Human) -> tuple[Human, str] | None:
        changed = self.work.human(human.name, self.work.role())
        if changed is None:
            return None
        kept: dict[str, object] = {"factors": human.factors}
        if human.behaviour is Behaviour.THREATENING:
            kept["behaviour"] = human.behaviour
        return changed.model_copy(update=kept), work_of(changed, goods=self.work.goods)

    def elsewhere(self, human: Human) -> tuple[Human, str] | None:
        tasks = self.work.underway(human.tasks)
        if tasks == human.tasks:
            return None
        return human.model_copy(update={"tasks": tasks}), f"is already at {tasks[0].path[0]} when the robot sets off"

    def heedless(self, human: Human) -> tuple[Human, str] | None:
        if human.behaviour is Behaviour.THREATENING:
            return None
        if human.behaviour is Behaviour.IMPASSIVE:
            return human.model_copy(update={"behaviour": Behaviour.REGULAR}), "steps aside for the robot"
        return human.model_copy(update={"behaviour": Behaviour.IMPASSIVE}), "does not step aside for the robot"

    def _idle(self, stops: Sequence[Stop]) -> int:
        """Draw the index of a stop, rather of an idle one."""
        return self.work.pick(range(len(stops)), [4.0 if stop.waypoint in self.idle else 1.0 for stop in stops])

    def _stops(self, human: Human) -> list[Stop] | None:
        """Return where a person's tasks start; None where one does not start at a place."""
        by_name = {place.name: place for place in self.work.places}
        stops = []
        for task in at_places(human.tasks):
            at = task.path[0]
            around = (place for place in self.work.places if at in place.waypoints)
            place = by_name.get(ends_of(task)[0]) or next(around, None)
            if place is None or at not in place.waypoints:
                return None
            stops.append(Stop(place, at))
        return stops

    def _rebuilt(self, human: Human, stops: list[Stop], words: str) -> tuple[Human, str] | None:
        """The person going round these stops, with the pauses still on the way; None if they are not joined."""
        tasks = self.work.tasks(stops, None, along_route=self.work.aim is not Aim.NONE)
        if not tasks:
            return None
        pauses = [pause for task in human.tasks for pause in task.stops]
        works = {ends_of(task)[1]: task.work for task in human.tasks}
        tasks = tuple(
            task.model_copy(update={"pauses": tuple(p for p in pauses if p.at in task.path[1:])}).working(
                works.get(ends_of(task)[1]) or task.work
            )
            for task in tasks
        )
        if at_places(human.tasks) != human.tasks:
            tasks = self.work.underway(tasks)
        return human.model_copy(update={"tasks": tasks}), words


MATES = {Aim.DELAY: 0.4}
"""How often somebody is drawn as a mate of the person before, by the aim: two people hold a robot up twice as much."""
MATES_AT_WORK = MATES | {Aim.SHARE: 0.15, Aim.MEET: 0.25, Aim.DISTURB: 0.25}
"""The same where work takes time: two abreast leave less room than one who paces."""
WORK_TRIES = 20
"""How often somebody is drawn for an activity before the next person is tried."""


_free: WeakKeyDictionary[World, dict[tuple[str, str, float], bool]] = WeakKeyDictionary()
"""Whether a person of a radius may start at a waypoint of a mission, alone: every proposal asks of the same ones."""


class HeuristicGenerator(Generator):
    """Plans people's work from the map, the route and what was measured. Deterministic: the brief's seed draws.

    `tries` people are drawn for every one that is kept, `changes` variants for every refinement. `individuals`: as
    in the study, everybody but the first draws the weights of their forces again at every launch; not where people are
    to hold the robot up, for a delay that hangs on those weights does not come back. `provoking`: the first
    person steps in front of the robot when it is near (HuNavSim's threatening behaviour), a misuse to be foreseen.
    `works`: people do something where a task ends; False: they turn round at once, as in the study.
    """

    name = "heuristic"

    def __init__(
        self,
        *,
        tries: int = 60,
        changes: int = 120,
        individuals: bool = True,
        provoking: bool = False,
        works: bool = True,
    ) -> None:
        if tries < 1 or changes < 1:
            raise ValueError(f"expected at least one try and one change, got {tries} and {changes}")
        self.tries, self.changes, self.individuals, self.provoking = tries, changes, individuals, provoking
        self.works = works

    def propose(self, brief: Brief, world: World) -> Proposal:
        """A new scenario, or a refinement of the one in the feedback."""
        route = brief.mission.route
        places = places_of(world, reachable_from=route.start)
        if len({name for place in places for name in place.waypoints}) < 2:
            return nowhere_to_walk(world, generator=self.name)
        plan = _Plan(self, brief, world, places)
        refined = brief.feedback.scenario if brief.kind == "refine" and brief.feedback is not None else None
        paths = [task.path for human in refined.people.humans for task in human.tasks] if refined else []
        if refined and all(path and world.grid.valid.issuperset(path) for path in paths):
            humans, reasoning = plan.refined(self.changes)
            moved = added(brief.mission, refined.mission)
            described = describe_changed(refined, humans, goods=plan.work.goods)
        else:
            humans, reasoning = plan.drafted(self.tries)
            humans, described = plan.described(humans)
            moved = left_behind(humans, brief.mission, world, plan.others)
        return answer(
            HumanConfiguration(humans=tuple(humans)),
            brief,
            world,
            generator=self.name,
            described=described,
            reasoning=reasoning,
            extra={"aim": plan.aim.name.lower()},
            moved=moved,
        )


class _Plan:
    """What one proposal is made from: the brief, the ground, people and their forecast."""

    def __init__(self, generator: HeuristicGenerator, brief: Brief, world: World, places: tuple[Place, ...]) -> None:
        self.brief, self.world, self.places = brief, world, places
        self.individuals, self.provoking = generator.individuals, generator.provoking
        self.rng = rng_of(brief, generator.name)
        self.free: dict[tuple[str, float], bool] = {}
        # Nearness, which disturbs everything, where the requirement declares no aim.
        self.aim = Aim.NONE if brief.requirement is None else brief.aim or Aim.SHARE
        self.ground = walking_graph(self.world, self.brief.mission.route)
        self.others = rng_of(self.brief, "heuristic/actors")
        worked = Counter(end for earlier in brief.memory for end in _ends(earlier.scenario.people.humans))
        self.work = PeopleSampler(self.ground, self.places, self.aim, self.rng, worked, works=generator.works)
        self.mates = (MATES_AT_WORK if generator.works else MATES).get(self.aim, 0.0)
        self.forecaster = forecaster_of(self.brief.mission, self.world)

    # -- a new scenario ----------------------------------------------------------------------------------------

    def drafted(self, tries: int) -> tuple[list[Human], str]:
        """People one after another, each the most promising of many beside those before."""
        humans: list[Human] = []
        for index in range(self.brief.humans):
            aimed = self.aim is not Aim.NONE and index < AIMED
            humans.append(self._best(index, humans, tries if aimed else 1))
            if self.provoking and aimed and not index:
                humans[0] = humans[0].model_copy(update={"behaviour": Behaviour.THREATENING})
        if self.aim is Aim.NONE:
            return humans, "Unguided: people do the work of the place; nothing was aimed at the robot's route."
        differs = f" Avoided what {len(self.brief.memory)} earlier scenarios worked at." if self.brief.memory else ""
        return humans, (
            f"Aim: {self.aim.value}. Of {tries} people drawn for each place in the team the most promising was kept."
            f"{differs} {_expected(self.forecaster(humans[:AIMED]))}"
        )

    def _best(self, index: int, humans: list[Human], tries: int) -> Human:
        """The most promising of the people drawn beside those before; nobody who would start on somebody else."""
        drawn: list[Human] = []
        unclear: Human | None = None
        for _ in range(20 * tries + 100):
            human = self._drawn(f"Human {index + 1}", humans)
            if human is not None and self._clear(human, humans):
                drawn.append(human)
                if len(drawn) == tries:
                    break
            else:
                unclear = human or unclear
        if len(drawn) > 1:
            forecasts = self.forecaster.compare([[*humans, human] for human in drawn])
            chosen = drawn[max(range(len(drawn)), key=lambda k: promise(self.aim, forecasts[k]))]
        else:
            chosen = drawn[0] if drawn else unclear or self._anybody(index)
        if chosen.group is not None:  # the other one of the two joins what was begun for both
            humans[-1] = humans[-1].model_copy(update={"group": chosen.group})
        differs = self.individuals and index and self.aim is not Aim.DELAY
        return chosen.model_copy(update={"factors": "random_normal"}) if differs else chosen

    def _drawn(self, name: str, humans: list[Human]) -> Human | None:
        """Somebody with work of their own, or, where people are to hold the robot up, a mate of the one before."""
        if humans and humans[-1].group is None and self.rng.random() < self.mates:
            return self.work.mate(name, humans[-1], len(humans))
        return self.work.human(name, self.work.role())

    def _anybody(self, index: int) -> Human:
        """Somebody between the first two joined waypoints, where no work could be drawn."""
        names = [name for place in self.places for name in place.waypoints]
        start = names[index % len(names)]
        end = next((o for o in names if o != start and self.work.way(start, o)), None)
        path = self.work.way(start, end) if end else (start,)
        assert path is not None
        back, (work, home) = path[::-1], (self.work.work_at(path[-1]), self.work.work_at(start))
        tasks = (Task.between(start, path[-1], path, work), Task.between(path[-1], start, back, home))
        return Human(name=f"Human {index + 1}", tasks=tasks, speed_m_s=1.0)

    def _clear(self, human: Human, others: list[Human]) -> bool:
        """Return whether a person starts clear of the robot, of obstacles and of the others."""
        begins, at = human.tasks[0].path[0], self.ground.at
        if not self._free_start(begins, human):
            return False
        return all(
            math.dist(at[begins], at[o.tasks[0].path[0]]) >= human.body_radius_m + o.body_radius_m for o in others
        )

    def _free_start(self, begins: str, human: Human) -> bool:
        """Return whether a person who is alone may start at a waypoint; remembered."""
        key = (begins, human.body_radius_m)
        if key not in self.free:
            known = {} if human.outline else _free.setdefault(self.world, {})  # an outline is not told by its radius
            asked = (self.brief.mission.id, *key)
            if asked not in known:
                at, mission = self.ground.at[begins], self.brief.mission
                gap = start_gap_m(human.body_radius_m, at, mission)
                known[asked] = gap >= START_CLEARANCE_M and not spawn_finding(human, at, [], mission, self.world)
            self.free[key] = known[asked]
        return self.free[key]

    def described(self, humans: list[Human]) -> tuple[list[Human], Described]:
        """Return the work of the hour from the world's list, the robot's task, and who does what where."""
        purpose = sentence(self.brief.mission.route.purpose)
        robot = f"The robot's task meanwhile: {purpose}." if purpose else "The robot drives meanwhile."
        activities, activity = self.world.activities, None
        named = [named_in(each, self.places) for each in activities]
        fits = self._preference(humans)
        done = [k for k in range(len(activities)) if any(follows(human, named[k]) for human in humans)]
        if done:
            activity = activities[max(done, key=lambda k: fits[k])]
        elif activities:
            humans, activity = self._put_to_work(humans, named)
        if self.world.actors:
            places = named_in(activity, self.places) if activity else ()
            worker = next((human.name for human in humans if places and follows(human, places)), None)
            humans = cast(humans, activity, worker, self.brief.mission, self.world, self.others)
        work = f"The work of the hour: {sentence(activity)}. " if activity else ""
        return humans, describe_new(humans, f"{work}{robot}", goods=self.work.goods)

    def _preference(self, humans: Sequence[Human]) -> NDArray[np.float64]:
        """How well each work of the place fits the people and differs from what is remembered, with a random part."""
        done = np.zeros(len(self.world.activities))
        for remembered in self.brief.memory if self.world.activities else ():
            fits = self._fits(remembered.scenario.people.humans) - 3.0 * done
            done[int(fits.argmax())] += 1
        preference: NDArray[np.float64] = self._fits(humans) - 3.0 * done + self.rng.random(len(done))
        return preference

    def _put_to_work(
        self, humans: list[Human], named: Sequence[Sequence[tuple[Place, ...]]]
    ) -> tuple[list[Human], str | None]:
        """Give somebody who is in no group, the last one first, work of the place; None where none can be done."""
        fits = self._preference(humans)
        for k in sorted(range(len(fits)), key=lambda k: -fits[k]):
            for index in reversed([i for i, human in enumerate(humans) if human.group is None and named[k]]):
                others = humans[:index] + humans[index + 1 :]
                for _ in range(WORK_TRIES):
                    human = self.work.human(humans[index].name, self.work.role(), named[k])
                    if human is not None and follows(human, named[k]) and self._clear(human, others):
                        kept = {"behaviour": humans[index].behaviour, "factors": humans[index].factors}
                        changed = human.model_copy(update=kept)
                        return [*humans[:index], changed, *humans[index + 1 :]], self.world.activities[k]
        return humans, None

    def _fits(self, humans: Sequence[Human]) -> NDArray[np.float64]:
        """How many words each work of the place shares with the names and kinds of the places people visit."""
        kinds = {place.name: place.kind for place in self.places}
        words = {word for stop in _ends(humans) for word in f"{stop} {kinds.get(stop, '')}".lower().split()}
        works = [{*text.lower().replace(",", "").split()} for text in self.world.activities]
        return np.array([sum(word.rstrip("s") in words for word in work) for work in works], dtype=np.float64)

    # -- a refinement ------------------------------------------------------------------------------------------

    def refined(self, variants: int) -> tuple[list[Human], str]:
        """The most promising of many small changes, by a forecast that fits what was measured; and why."""
        feedback = self.brief.feedback
        assert feedback is not None
        base = list(feedback.scenario.people.humans)
        while len(base) < self.brief.humans:
            base.append(self._best(len(base), base, 1))
        base = base[: self.brief.humans]
        aimed = slice(AIMED)
        fitted = self.forecaster.fitted(feedback) if len(base) <= AIMED else self.forecaster
        changes = _Changes(self.work, feedback)
        drawn = (self._variant(base, changes) for _ in range(1 if self.aim is Aim.NONE else variants))
        options = [(humans, words) for humans, words in drawn if humans != base]
        options = [o for o in options if all(self._clear(h, []) for h in o[0])] or options
        if not options:
            return base, "No change was possible; the configuration is proposed again."
        forecasts = fitted.compare([base[aimed], *(humans[aimed] for humans, _ in options)])
        order = sorted(range(len(options)), key=lambda k: -promise(self.aim, forecasts[k + 1]))
        # The forecast is rough: one of the best few is as good a guess as the best, and differs from try to try.
        chosen = order[int(self.rng.integers(min(FINALISTS[self.aim], len(order))))]
        humans, words = options[chosen]
        change = f" after {feedback.previous_mean:.3g}" if feedback.previous_mean is not None else ""
        reasoning = (
            f"Aim: {self.aim.value}. Measured {feedback.mean:.3g}{change}. Forecast fitted to it: "
            f"{_expected(forecasts[0])} Of {len(options)} variants one of the best: {'; '.join(words)}. "
            f"{_expected(forecasts[chosen + 1])}"
        )
        return humans, reasoning

    def _as_mate(self, humans: list[Human], index: int) -> tuple[Human, str] | None:
        """Now and then, and only where people are to hold the robot up: the person as a mate of another."""
        if len(humans) < 2 or self.rng.random() >= 0.2 * self.mates:
            return None
        other = humans[index - 1]
        if other.group is not None or humans[index].group is not None:
            return None
        group = 1 + max((h.group for h in humans if h.group is not None), default=0)
        mate = self.work.mate(humans[index].name, other, group)
        if mate is None:
            return None
        return mate.model_copy(update={"factors": humans[index].factors}), f"works together with {other.name}"

    def _variant(self, base: list[Human], changes: _Changes) -> tuple[list[Human], list[str]]:
        """One to three small changes that leave everybody a clear start."""
        humans, words = list(base), []
        for _ in range(int(self.rng.integers(1, 4))):
            index = int(self.rng.integers(len(humans)))
            changed = self._as_mate(humans, index) or changes.once(humans[index])
            if changed is None or not self._clear(changed[0], humans[:index] + humans[index + 1 :]):
                continue
            humans = _together(humans, index, changed[0])
            words.append(f"{changed[0].name} {changed[1]}")
        return humans, words


def _together(humans: list[Human], index: int, changed: Human) -> list[Human]:
    """Return everybody with one person changed; a group keeps its pace and time, or is left for other work."""
    old, result = humans[index], list(humans)
    result[index] = changed
    if changed.group != old.group:
        if changed.group is not None:
            result[index - 1] = result[index - 1].model_copy(update={"group": changed.group})
    elif old.group is None:
        return result
    elif changed.tasks == old.tasks:
        pace = {"speed_m_s": changed.speed_m_s, "start_delay_s": changed.start_delay_s}
        return [h.model_copy(update=pace) if h.group == old.group else h for h in result]
    else:
        result[index] = changed.model_copy(update={"group": None})
    sizes = Counter(h.group for h in result)
    return [h.model_copy(update={"group": None}) if h.group is not None and sizes[h.group] < 2 else h for h in result]


def _ends(humans: Sequence[Human]) -> set[str]:
    """Return the areas and waypoints at which people's tasks end."""
    return {end for human in humans for task in human.tasks for end in ends_of(task)}


def _expected(forecast: Forecast) -> str:
    return (
        f"Expected: mean gap {forecast.mean_gap_m:.2f} m, least {forecast.least_gap_m:.2f} m, "
        f"way occupied for {forecast.blocked_s:.1f} s, arrival after {forecast.duration_s:.0f} s."
    )
