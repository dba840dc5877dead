"""From a map, objects, labels and a grid specification to a World."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from rvsg.world.doors import Door
from rvsg.world.doorways import floor_with_open_doors
from rvsg.world.grid import Grid, GridSpec
from rvsg.world.lattice import area_waypoints, build_grid
from rvsg.world.space import Space, human_space, in_same_space, robot_space
from rvsg.world.world import Area, Description, OccupancyMap, Point, Route, SolidObject, World

LIDAR_HEIGHT_M = 0.21


def build_world(
    *,
    name: str,
    occupancy: OccupancyMap,
    objects: Sequence[SolidObject] = (),
    areas: Sequence[Area] = (),
    routes: Sequence[Route] = (),
    grid_spec: GridSpec | None = None,
    title: str = "",
    lidar_height_m: float = LIDAR_HEIGHT_M,
    activities: Sequence[str] = (),
    description: Description | None = None,
    map_offset: Point = (0.0, 0.0),
    doors: Sequence[Door] = (),
    actors: Sequence[str] = (),
    trolley_work: Mapping[str, bool] | None = None,
) -> World:
    """Lay the grid and give every area without waypoints the ones it is worked from.

    Coordinates are metres in the world frame, the occupancy map's in the map frame (world = map + `map_offset`).
    Raises InputError where no grid can be laid.
    """
    spec = grid_spec or GridSpec()
    world = World(
        name=name,
        title=title or name,
        objects=tuple(objects),
        occupancy=occupancy,
        lidar_height_m=lidar_height_m,
        grid=Grid(rows=(), columns=(), waypoints=(), hops=()),
        areas=tuple(areas),
        routes=tuple(routes),
        activities=tuple(activities),
        description=description,
        map_offset=map_offset,
        grid_spec=spec,
        doors=tuple(doors),
        actors=tuple(actors),
        trolley_work=dict(trolley_work or {}),
    )
    human, robot = human_space(world), robot_space(world)
    seeds = [(route.start.x, route.start.y) for route in routes]
    grid = build_grid(spec, human, robot, seeds=seeds, floor=floor_with_open_doors(world))
    filled = tuple(area if area.waypoints else _with_waypoints(area, grid, human, world.objects) for area in areas)
    return in_same_space(replace(world, grid=grid, areas=filled), world)


def _with_waypoints(area: Area, grid: Grid, human: Space, objects: Sequence[SolidObject]) -> Area:
    return area.model_copy(update={"waypoints": area_waypoints(area.outline, grid, human, objects=objects)})
