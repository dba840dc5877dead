"""The embedded simulator as a whole: an episode in the shipped warehouse."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.coded import coded, nearest
from tests.simulation.parts import TIAGO, route, standing

from rvsg.core.errors import InputError, InvalidOptions, SimulationError, UnknownName
from rvsg.core.kernels import kernel
from rvsg.core.records import Pose
from rvsg.core.references import refer
from rvsg.scenario.scenario import HumanAgent
from rvsg.simulation.archive import PackedRun, run_from_json, run_to_json
from rvsg.simulation.embedded import base
from rvsg.simulation.embedded import state as st
from rvsg.simulation.embedded.behaviour_tree import choose_dwb
from rvsg.simulation.embedded.episode import Episode, Outside
from rvsg.simulation.embedded.navfn import BLOCKED
from rvsg.simulation.embedded.people.crowd import begins_early
from rvsg.simulation.embedded.profiles import Noise, profile
from rvsg.simulation.embedded.simulator import empty_room, simulate_agents
from rvsg.simulation.embedded.state import State
from rvsg.simulation.run import Outcome, Run
from rvsg.simulation.stacks.stack_choice import StackChoice
from rvsg.world.world import World
from rvsg.world.world_folder import load_world


@pytest.fixture(scope="module")
def warehouse() -> World:
    return load_world("warehouse")


def walker(world: World, *names: str) -> HumanAgent:
    places = tuple(world.grid.position(name) for name in names)
    return HumanAgent(name=names[0], start=places[0], goals=places, pauses_s=(0.0,) * len(places))


def equal(a: Run, b: Run) -> bool:
    pairs = [(getattr(a.trajectory, k), getattr(b.trajectory, k)) for k in vars(a.trajectory)]
    pairs += [(getattr(a.log, k), getattr(b.log, k)) for k in vars(a.log)] + [(a.imu, b.imu)]
    return a.outcome is b.outcome and all(np.array_equal(x, y) for x, y in pairs)


@pytest.mark.parametrize("name", ["default", "published-study"])
def test_the_robot_reaches_its_goal_among_people(warehouse: World, name: str) -> None:
    agents = [walker(warehouse, "G13", "F13", "F14"), walker(warehouse, "E20", "E19", "E18", "F18")]
    run = simulate_agents(warehouse, warehouse.route("route_1"), agents, options=profile(name), seed=1)
    assert run.outcome is Outcome.REACHED
    end = np.hypot(run.trajectory.x[-1] - run.goal[0], run.trajectory.y[-1] - run.goal[1])
    assert end <= 0.25 + 0.02
    assert 15.0 < run.log.t[-1] < 25.0
    assert np.allclose(np.diff(run.trajectory.t), 0.05)
    assert np.all(np.abs(np.diff(run.log.t[:-1]) - 0.505) < 0.02)
    assert len(run.imu) == pytest.approx(100 * run.trajectory.t[-1], abs=10)
    assert run.trajectory.v.max() == pytest.approx(0.5)


def test_without_any_noise_the_seed_does_not_matter(warehouse: World) -> None:
    none = dict.fromkeys(Noise.model_fields, 0)
    way, agents = warehouse.route("route_1"), [walker(warehouse, "G13", "F13", "F14")]
    a, b = (simulate_agents(warehouse, way, agents, options=profile(noise=none), seed=seed) for seed in (1, 2))
    assert equal(a, b)


FREE_START = (-0.1, -0.35, 0.0)
FREE_GOAL = (1.75, -8.6, -1.5)
IN_BUCKET = (-1.83, -6.37, 0.0)


@pytest.mark.parametrize(
    ("start", "goal", "outcome"),
    [
        (IN_BUCKET, FREE_GOAL, Outcome.BLOCKED_START),
        ((-50.0, 0.0, 0.0), FREE_GOAL, Outcome.BLOCKED_START),
        ((6.75, 2.1, 0.0), FREE_GOAL, Outcome.BLOCKED_START),
        (FREE_START, IN_BUCKET, Outcome.NO_PATH),
        (FREE_START, (50.0, 0.0, 0.0), Outcome.NO_PATH),
        (FREE_START, FREE_START, Outcome.REACHED),
        # Inside inflation: the robot drives to the nearest reachable point and slides along what it touches.
        (FREE_START, (-1.1, -6.37, 0.0), Outcome.REACHED),
    ],
)
def test_bad_starts_and_goals_are_outcomes(
    warehouse: World, start: tuple[float, float, float], goal: tuple[float, float, float], outcome: Outcome
) -> None:
    run = simulate_agents(warehouse, route(start, goal), [walker(warehouse, "G13", "G14")], seed=1)
    assert run.outcome is outcome
    assert len(run.trajectory) >= 1
    assert len(run.log) >= 1
    assert run.recoveries <= 6


@pytest.mark.parametrize(("ahead_m", "outcome"), [(0.57, Outcome.BLOCKED_START), (0.3, Outcome.TIMED_OUT)])
def test_a_lidar_on_a_mast_that_is_in_a_wall_at_the_start_blocks_it(ahead_m: float, outcome: Outcome) -> None:
    """The footprint ends 0.36 m ahead of the middle, the wall of the room begins 0.55 m ahead of it."""
    mast = TIAGO.lidars[0].replace(x=ahead_m, y=0.0, height_m=None)
    way, robot = route((2.4, 0.0), (-2.0, 0.0), 0.1), TIAGO.replace(lidars=(mast,))
    assert simulate_agents(empty_room(), way, [], robot=robot, seed=1).outcome is outcome


def test_people_may_start_on_the_robot_on_each_other_and_in_an_obstacle(warehouse: World) -> None:
    on_robot = HumanAgent(name="a", start=(-0.1, -0.35), goals=((-0.1, -0.35), (0.8, -0.35)), pauses_s=(0.0, 0.0))
    within = HumanAgent(name="b", start=IN_BUCKET[:2], goals=(IN_BUCKET[:2], (0.8, -6.0)), pauses_s=(0.0, 0.0))
    for name in ("default", "published-study"):
        way, people = route(FREE_START, FREE_GOAL), [on_robot, on_robot, within]
        run = simulate_agents(warehouse, way, people, options=profile(name), seed=2)
        assert (run.outcome is Outcome.BLOCKED_START) == (name == "default")
        assert name == "default" or not [event for event in run.events if event.kind == "robot_contact"]
        assert np.isfinite(run.trajectory.human_x).all()
    run = simulate_agents(warehouse, route(FREE_START, FREE_GOAL), [within, within], seed=2)
    assert run.outcome is not Outcome.BLOCKED_START
    assert np.isfinite(run.trajectory.human_x).all()


def test_numbers_that_make_no_sense_are_refused_before_the_start(warehouse: World) -> None:
    bad = warehouse.route("route_1").model_copy(update={"start": Pose.model_construct(x=math.nan, y=0.0, yaw=0.0)})
    with pytest.raises(InputError, check=coded("route-not-finite")):
        simulate_agents(warehouse, bad, [], seed=0)
    with pytest.raises(InputError, check=coded("time-limit")):
        simulate_agents(warehouse, route(FREE_START, FREE_GOAL, 3601.0), [], seed=0)
    with pytest.raises(InvalidOptions, check=lambda error: error.keys == ("lidar_rays",)):
        profile(lidar_rays=0)
    with pytest.raises(UnknownName, check=nearest("published-study")):
        profile("published-studi")


def test_the_robot_drives_through_the_poses_of_a_route_in_order(warehouse: World) -> None:
    through = (Pose(x=0.8, y=3.0), Pose(x=0.0, y=0.5))
    long = route(FREE_START, FREE_GOAL, 80.0).model_copy(update={"through": through})
    run = simulate_agents(warehouse, long, [], seed=1)
    assert run.outcome is Outcome.REACHED
    first, second = (int(np.argmin(np.hypot(run.trajectory.x - pose.x, run.trajectory.y - pose.y))) for pose in through)
    assert np.hypot(run.trajectory.x[first] - 0.8, run.trajectory.y[first] - 3.0) < 0.75
    assert first < second


def test_the_robot_drives_round_a_standing_person() -> None:
    run = simulate_agents(empty_room(), route((-2.0, 0.0), (2.0, 0.0)), [standing(0.0, 0.3)], seed=1)
    assert run.outcome is Outcome.REACHED
    apart = np.hypot(run.trajectory.x - run.trajectory.human_x[:, 0], run.trajectory.y - run.trajectory.human_y[:, 0])
    assert apart.min() > 0.25


def test_people_displayed_late_are_not_seen_before_they_begin_to_walk() -> None:
    waiting, way = standing(0.0, 0.3).replace(start_delay_s=100.0), route((-2.0, 0.0), (2.0, 0.0))

    def path(agents: list[HumanAgent], late: bool) -> np.ndarray:
        options = profile("default", humans_displayed_late=late, human_defects=True)
        return simulate_agents(empty_room(), way, agents, options=options, seed=1).trajectory.y

    alone = path([], late=True)
    assert np.array_equal(path([waiting], late=True), alone)
    seen = path([waiting], late=False)
    assert seen.size != alone.size or not np.allclose(seen, alone, atol=0.05)


@pytest.mark.parametrize("share", [0.0, 0.22, 1.0])
def test_the_share_of_early_starts_is_kept(share: float) -> None:
    assert np.mean([begins_early(share, seed) for seed in range(2000)]) == pytest.approx(share, abs=0.03)


def test_published_people_move_for_the_first_time_at_the_first_row(warehouse: World) -> None:
    agents = [walker(warehouse, "F13", "F14", "F15", "F16")]
    options = profile("published-study", human_early_start=0.0)
    for seed in range(6):
        run = simulate_agents(warehouse, warehouse.route("route_1"), agents, options=options, seed=seed)
        moved = np.hypot(
            run.trajectory.human_x[:, 0] - agents[0].start[0], run.trajectory.human_y[:, 0] - agents[0].start[1]
        )
        # Moved by the tick at 0 or 10 ms before: 0.06 m at the first or second of the rows of 50 ms.
        assert 0.0 < moved[1] < 0.08
        # The log shows people as they were before the last tick.
        assert run.log.human_x[0, 0] == agents[0].start[0]


def test_rows_of_the_log_come_at_the_50th_or_the_51st_message(warehouse: World) -> None:
    run = simulate_agents(warehouse, warehouse.route("route_1"), [], options=profile("published-study"), seed=3)
    intervals = np.diff(run.log.t)[:-1]
    assert set(np.round(intervals, 6)) == {0.5, 0.51}
    without = simulate_agents(
        warehouse, warehouse.route("route_1"), [], options=profile("published-study", noise={"log_interval": 0}), seed=3
    )
    assert np.allclose(np.diff(without.log.t)[:-1], 0.5057)


def test_a_run_holds_the_groups_of_its_people_in_the_store_too(warehouse: World) -> None:
    ways = ((("G13", "F13"), 2), (("G14", "F14"), 2), (("E20", "E19"), None))
    agents = [walker(warehouse, *names).replace(group=group) for names, group in ways]
    run = simulate_agents(warehouse, warehouse.route("route_1"), agents, seed=1)
    for again in (run, PackedRun.of(run).unpack(), run_from_json(run_to_json(run))):
        assert again.human_groups == (2, 2, None)


def behaving(**behaviours: object) -> StackChoice:
    """The stack of the study with these keys of `navigation.behaviours`."""
    return StackChoice.of("nav2-dwb-humble", {"behaviours": behaviours})


class TestOutside:
    """What is computed outside of the compiled loop, which is left for it and entered again."""

    def test_dwb_called_from_outside_and_a_probe_give_the_same_run(self, warehouse: World) -> None:
        agents = [walker(warehouse, "G13", "F13", "F14")]
        probed: list[tuple[float, float, float]] = []

        def choose(episode: Episode) -> tuple[float, float] | None:
            answer = np.zeros(4)
            state = episode.state
            ask_dwb(refer(state, stack=refer(state.stack), walls=refer(state.walls), own=refer(state.own)), answer)
            return (answer[1], answer[2]) if answer[0] else None

        def probe(episode: Episode) -> None:
            probed.append((episode.t, episode.state.body[base.X], episode.state.body[base.V]))

        way = warehouse.route("route_1")
        plain = simulate_agents(warehouse, way, agents, seed=1)
        outside = simulate_agents(warehouse, way, agents, seed=1, outside=Outside(control=choose, probe=probe))
        assert equal(plain, outside)
        rows = np.array(probed)
        path = plain.trajectory
        assert np.array_equal(rows, np.column_stack([path.t, path.x, path.v])[: len(rows)])
        assert len(path) - len(rows) <= 1

    @pytest.mark.parametrize(("waits", "least", "most"), [(False, 0.01, 0.06), (True, 0.1, 1.1)])
    def test_who_needs_a_cleared_costmap_waits_for_its_next_update(
        self, warehouse: World, waits: bool, least: float, most: float
    ) -> None:
        """The local map is cleared after 0.3 s without a command, and both are with the first recovery."""
        asked: list[float] = []
        brief = warehouse.route("route_1").model_copy(update={"time_limit_s": 1.3})
        simulate_agents(
            warehouse, brief, [], stack=behaving(waits_for_costmaps=waits), seed=1,
            outside=Outside(control=lambda episode: asked.append(episode.t)),
        )  # fmt: skip
        assert least < np.diff(asked).max() < most

    @pytest.mark.parametrize(
        ("stack", "outcome", "recoveries"),
        [
            (behaving(), Outcome.REACHED, 0),
            (behaving(waits_for_costmaps=True), Outcome.REACHED, 1),
            (None, Outcome.ABORTED, 0),
            (StackChoice.of("nav2-dwb", {"costmaps": {"global_update_hz": 100.0}}), Outcome.REACHED, 0),
        ],
        ids=["published", "humble", "jazzy", "jazzy-costmap-before-controller"],
    )
    def test_what_follows_a_plan_on_the_way_that_fails_once(
        self, warehouse: World, stack: StackChoice | None, outcome: Outcome, recoveries: int
    ) -> None:
        blocked: list[float] = []

        def block(episode: Episode) -> None:
            """Block every cell just before the plan is due that follows 3 s; the next update clears them again."""
            due = episode.t - episode.state.times[st.PLAN_T] > 0.995
            if episode.t > 3.0 and due and not blocked:
                blocked.append(episode.t)
                episode.state.costs[:] = BLOCKED

        run = simulate_agents(
            warehouse, warehouse.route("route_1"), [], stack=stack, seed=1,
            outside=Outside(probe=block, probe_ticks=1),
        )  # fmt: skip
        assert len(blocked) == 1
        assert (run.outcome, run.recoveries) == (outcome, recoveries)

    def test_an_answer_that_is_not_finite_is_an_error(self, warehouse: World) -> None:
        with pytest.raises(SimulationError):
            outside = Outside(control=lambda _: (math.nan, 0.0))
            simulate_agents(warehouse, warehouse.route("route_1"), [], outside=outside)


@kernel
def ask_dwb(state: State, answer: NDArray[np.float64]) -> None:
    choose_dwb(state, answer)
