"""Make, check, draw, save and compare worlds. The names load on first use."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rvsg.core.lazy import lazily

if TYPE_CHECKING:
    from rvsg.api.trial import SimulatedTrial as SimulatedTrial
    from rvsg.api.trial import trial_of as trial_of
    from rvsg.world.authoring.check import check_world as check_world
    from rvsg.world.authoring.create import Created as Created
    from rvsg.world.authoring.create import world_from_map as world_from_map
    from rvsg.world.authoring.create import world_from_objects as world_from_objects
    from rvsg.world.authoring.create import world_from_sdf as world_from_sdf
    from rvsg.world.authoring.readme import write_readme as write_readme
    from rvsg.world.authoring.remarks import Remark as Remark
    from rvsg.world.compare import differences as differences
    from rvsg.world.drawing import GRID as GRID
    from rvsg.world.drawing import LABELLED as LABELLED
    from rvsg.world.drawing import draw_plan as draw_plan
    from rvsg.world.drawing import png_bytes as png_bytes
    from rvsg.world.drawing import tiles as tiles
    from rvsg.world.drawing.birdseye import birdseye as birdseye
    from rvsg.world.drawing.svg import floor_plan_svg as floor_plan_svg
    from rvsg.world.grid import GridSpec as GridSpec
    from rvsg.world.io.load import SHIPPED as SHIPPED
    from rvsg.world.io.load import load_world as load_world
    from rvsg.world.io.load import shipped_worlds as shipped_worlds
    from rvsg.world.io.save import save_world as save_world
    from rvsg.world.route_words import route_paragraph as route_paragraph
    from rvsg.world.world import Description as Description
    from rvsg.world.world import World as World

__getattr__ = lazily(
    __name__,
    {
        "Created": "rvsg.world.authoring.create",
        "Description": "rvsg.world.world",
        "GRID": "rvsg.world.drawing",
        "GridSpec": "rvsg.world.grid",
        "LABELLED": "rvsg.world.drawing",
        "SimulatedTrial": "rvsg.api.trial",
        "Remark": "rvsg.world.authoring.remarks",
        "SHIPPED": "rvsg.world.io.load",
        "World": "rvsg.world.world",
        "birdseye": "rvsg.world.drawing.birdseye",
        "check_world": "rvsg.world.authoring.check",
        "differences": "rvsg.world.compare",
        "draw_plan": "rvsg.world.drawing",
        "floor_plan_svg": "rvsg.world.drawing.svg",
        "load_world": "rvsg.world.io.load",
        "png_bytes": "rvsg.world.drawing",
        "route_paragraph": "rvsg.world.route_words",
        "save_world": "rvsg.world.io.save",
        "shipped_worlds": "rvsg.world.io.load",
        "trial_of": "rvsg.api.trial",
        "tiles": "rvsg.world.drawing",
        "world_from_map": "rvsg.world.authoring.create",
        "world_from_objects": "rvsg.world.authoring.create",
        "world_from_sdf": "rvsg.world.authoring.create",
        "write_readme": "rvsg.world.authoring.readme",
    },
)
