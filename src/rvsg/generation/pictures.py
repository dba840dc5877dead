"""The pictures of a world that a model is shown; the last few are kept, since every call of a campaign shows them."""

from __future__ import annotations

from rvsg.generation.vlm.messages import Picture
from rvsg.world.world import Route, World

Way = tuple[tuple[float, float, float], ...]
PICTURE_WIDTH_PX = 1600
MAP_WIDTH_PX, SMALL_MAP_WIDTH_PX = 1024, 512
"""Widths of the labelled map. Services cut pictures into tiles of 512 x 512 and charge for each."""
_MOST_DRAWN = 8
_DRAWN: dict[tuple[str, str, str, Way], tuple[Picture, Picture, Picture]] = {}
_SEEN: dict[tuple[str, str], Picture] = {}


def pictures_of(world: World, route: Route | None = None, way: Way = ()) -> tuple[Picture, Picture]:
    """The labelled map (with the route) and the grid picture.

    Args:
        way: The drive without people as (seconds, x, y). The labelled map shows it with a mark every 5 s, instead of
            the straight lines between the points of the route.
    """
    return _drawn(world, route, way)[:2]


def small_map_of(world: World, route: Route | None = None, way: Way = ()) -> Picture:
    """The labelled map drawn small, with all of its names, for a third of the price.

    It is enough for a refinement, which knows its areas and waypoints; the text holds the grid.
    """
    return _drawn(world, route, way)[2]


def _drawn(world: World, route: Route | None, way: Way) -> tuple[Picture, Picture, Picture]:
    key = (world.id, world.title, route.id if route else "", way)
    if key not in _DRAWN:
        from rvsg.world.drawing import grid_picture, labelled_map, png_bytes

        drive = way if _moves(way) else None
        labelled, small = (
            Picture(name="labelled map", png=png_bytes(labelled_map(world, width_px=width, route=route, way=drive)))
            for width in (MAP_WIDTH_PX, SMALL_MAP_WIDTH_PX)
        )
        grid = Picture(name="grid of waypoints", png=png_bytes(grid_picture(world, width_px=PICTURE_WIDTH_PX)))
        while len(_DRAWN) >= _MOST_DRAWN:
            _DRAWN.pop(next(iter(_DRAWN)))
        _DRAWN[key] = (labelled, grid, small)
    return _DRAWN[key]


def _moves(way: Way) -> bool:
    return len({(x, y) for _, x, y in way}) > 1


def birdseye_of(world: World) -> Picture | None:
    """The world seen slantingly from above; None for a world from a bare map, which does not know its heights.

    Shown once, when the world is described: heights tell where people see each other, and what lies on a map. Where
    things are it tells worse than the map (tall things hide what is behind them), so prompts of scenarios do not
    show it.
    """
    if not world.objects:
        return None
    key = (world.id, world.title)
    if key not in _SEEN:
        from rvsg.world.drawing import png_bytes
        from rvsg.world.drawing.birdseye import birdseye

        _SEEN.clear()
        _SEEN[key] = Picture(name="bird's-eye view", png=png_bytes(birdseye(world, width_px=PICTURE_WIDTH_PX)))
    return _SEEN[key]
