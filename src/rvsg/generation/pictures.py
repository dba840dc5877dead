"""The pictures of a world that a model is shown; the last few are kept, since every call of a campaign shows them."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from rvsg.generation.vlm.messages import Picture
from rvsg.world.world import Route, World

if TYPE_CHECKING:
    from PIL.Image import Image

Way = tuple[tuple[float, float, float], ...]
PICTURE_WIDTH_PX = 1600
MAP_WIDTH_PX, SMALL_MAP_WIDTH_PX = 1024, 512
"""Widths of the labelled map. Services cut pictures into tiles of 512 x 512 and charge for each."""
_MOST_KEPT = 24
_KEPT: dict[tuple[object, ...], Picture] = {}


def pictures_of(world: World, route: Route | None = None, way: Way = ()) -> tuple[Picture, Picture]:
    """The labelled map (with the route) and the grid picture.

    Args:
        way: The drive without people as (seconds, x, y). The labelled map shows it with a mark every 5 s, instead of
            the straight lines between the points of the route.
    """
    from rvsg.world.drawing import grid_picture

    name = "grid of waypoints"
    grid = _kept((name, world.id, world.title), lambda: grid_picture(world, width_px=PICTURE_WIDTH_PX))
    return _labelled(world, route, way, MAP_WIDTH_PX), grid


def small_map_of(world: World, route: Route | None = None, way: Way = ()) -> Picture:
    """The labelled map drawn small, with all of its names, for a third of the price.

    It is enough for a refinement, which knows its areas and waypoints; the text holds the grid.
    """
    return _labelled(world, route, way, SMALL_MAP_WIDTH_PX)


def _labelled(world: World, route: Route | None, way: Way, width_px: int) -> Picture:
    from rvsg.world.drawing import labelled_map

    drive = way if _moves(way) else None
    key = ("labelled map", world.id, world.title, route.id if route else "", way, width_px)
    return _kept(key, lambda: labelled_map(world, width_px=width_px, route=route, way=drive))


def _kept(key: tuple[str, *tuple[object, ...]], draw: Callable[[], Image]) -> Picture:
    """Return the picture of a key, whose first part is its name; drawn if it is not kept."""
    if key not in _KEPT:
        from rvsg.world.drawing import png_bytes

        picture = Picture(name=key[0], png=png_bytes(draw()))
        while len(_KEPT) >= _MOST_KEPT:
            _KEPT.pop(next(iter(_KEPT)))
        _KEPT[key] = picture
    return _KEPT[key]


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
    from rvsg.world.drawing.birdseye import birdseye

    return _kept(("bird's-eye view", world.id, world.title), lambda: birdseye(world, width_px=PICTURE_WIDTH_PX))
