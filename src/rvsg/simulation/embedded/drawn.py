"""Random numbers of one run, each from a stream of its own."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rvsg.core.seeds import stream
from rvsg.simulation.embedded import base
from rvsg.simulation.embedded.options import SimulatorOptions
from rvsg.simulation.embedded.people.crowd import PERIOD_S, PeopleOptions, beginning, begins_early
from rvsg.simulation.embedded.scene import Scene, Surroundings
from rvsg.simulation.embedded.sensing.localisation import Localisation, known_offset, particle_filter
from rvsg.simulation.embedded.state import Settings
from rvsg.world.world import Route, World

Floats = NDArray[np.float64]

LATE_ROBOT_S = 0.035
"""How much later the robot begins in the runs in which people begin sooner; from the logs, like their share."""
LONG_INTERVALS = 0.57
"""The share of the log's rows that come 0.51 s after the one before, not 0.50 s; from 20 892 intervals in the logs."""


def people_options(options: SimulatorOptions) -> PeopleOptions:
    """Return what of the options concerns people."""
    low, high = options.human_start_s
    middle, scale = 0.5 * (low + high), options.noise.human_start
    return PeopleOptions(
        published_defects=options.human_defects,
        factor_noise=options.noise.human_factors,
        start_jitter_s=(middle + scale * (low - middle), middle + scale * (high - middle)),
        early_start=_early_start(options),
        leg_phase_noise=options.noise.gait > 0.0,
    )


def _early_start(options: SimulatorOptions) -> float:
    """The share of runs in which people begin sooner; none where the noise of their start is off."""
    return min(1.0, options.noise.human_start) * options.human_early_start


def draw_settings(
    world: World, route: Route, options: SimulatorOptions, around: Surroundings, seed: int
) -> tuple[Settings, Scene, tuple[float, float]]:
    """The drawn numbers of a run, the scene, and the offset between world and map."""
    noise = options.noise
    clock = _clock(options, seed)
    spread = 0.0 if options.localisation == "amcl" else noise.localisation * options.localisation_sd_m
    shift = spread * stream(seed, "localisation").standard_normal(2)
    low, high = options.result_delay_s
    delay = 0.5 * (low + high) + noise.result_delay * (high - low) * (stream(seed, "result").random() - 0.5)
    low, high = options.robot_start_s
    start = 0.5 * (low + high) + noise.robot_start * (high - low) * (stream(seed, "robot/start").random() - 0.5)
    if begins_early(_early_start(options), seed):
        start += LATE_ROBOT_S
    scene, closed = around.scene_at(route.start.x, route.start.y)
    offset = (world.map_offset[0] + float(shift[0]), world.map_offset[1] + float(shift[1]))
    phase = 0.0
    scan_phase = 0
    if noise.phases > 0.0:
        phase = 0.01 * int(stream(seed, "phases/people").integers(0, 10))
        scan_phase = int(stream(seed, "phases/lidar").integers(0, 10))
    if options.human_ticks_from_start:
        phase = beginning(people_options(options), seed) % PERIOD_S
    settings = Settings(
        clock=float(clock),
        yaw_gain=float(options.yaw_gain),
        time_limit_s=float(route.time_limit_s),
        result_delay_s=float(max(0.0, delay)),
        people_phase_s=float(phase),
        scan_phase_ticks=scan_phase,
        robot_start_s=float(start),
        lidar_noise=float(noise.lidar),
        humans_displayed_late=options.humans_displayed_late,
        solid_walls=options.solid_walls,
        closed=bool(closed),
    )
    return settings, scene, offset


def _clock(options: SimulatorOptions, seed: int) -> float:
    """Simulated over wall seconds of a run; the mean of all runs where its noise is off."""
    if options.clock_ratio_sd == 0.0 and options.clock_slow_share == 0.0:
        return options.clock_ratio
    rng = stream(seed, "clock")
    spread = options.clock_ratio_sd * rng.standard_normal()
    share = options.clock_slow_share
    mean = share * options.clock_slow_ratio + (1.0 - share) * options.clock_ratio
    drawn = (options.clock_slow_ratio if rng.random() < share else options.clock_ratio) + spread
    return float(mean + options.noise.clock * (drawn - mean))


def new_localisation(
    world: World,
    route: Route,
    options: SimulatorOptions,
    around: Surroundings,
    offset: tuple[float, float],
    seed: int,
) -> Localisation:
    """What the robot knows of its place at the start."""
    if options.localisation == "known":
        return known_offset(*offset)
    return particle_filter(
        around.beam_scores,
        world.occupancy,
        around.robot.lidars[0],
        (route.start.x, route.start.y, float(base.wrap(route.start.yaw))),
        around.robot.lidars[0].noise_m * options.noise.lidar,
        stream(seed if options.noise.localisation > 0.0 else 0, "localisation"),
        differential=around.robot.drive.kind != "omnidirectional",
    )


def draw_phases(options: SimulatorOptions, seed: int) -> Floats:
    """Phases of smoother, local and global map in seconds."""
    if options.noise.phases == 0.0:
        return np.zeros(3)
    return 0.01 * np.array(
        [stream(seed, f"phases/{name}").integers(0, n) for name, n in (("smoother", 5), ("local", 20), ("global", 100))]
    )


def draw_intervals(options: SimulatorOptions, seed: int, route: Route) -> Floats:
    """Wall seconds between rows of the log: the first feedback message, every 10 ms, after 0.5 s.

    In the published logs that is the 50th message, or, as often as `LONG_INTERVALS` says, the 51st; nothing between.
    """
    rows = int(route.time_limit_s / 0.5) + 4
    long = stream(seed, "log").random(rows) < LONG_INTERVALS
    spread = options.noise.log_interval * (long.astype(np.float64) - LONG_INTERVALS)
    return np.asarray(0.5 + 0.01 * (LONG_INTERVALS + spread), np.float64)
