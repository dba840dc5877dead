"""The floor plan as the pages of the report show it."""

from __future__ import annotations

import html

from rvsg.report.names import narrow_names, narrow_size
from rvsg.world.drawing.sheet import DARK, LIGHT
from rvsg.world.drawing.svg import FloorPlan, floor_plan
from rvsg.world.world import World


def floor_svg(world: World) -> str:
    """Return the floor plan as one SVG element for the replay component, with the colours of the areas."""
    floor = floor_plan(world, tooltips=False)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" class="map" viewBox="{floor.view_box}" role="img" '
        f'aria-label="Floor plan of {html.escape(world.title, quote=True)} with the robot and the people">'
        f"<style>{area_colours(world, floor)}</style>{floor.shapes}{narrow_names(floor)}</svg>"
    )


def area_colours(world: World, floor: FloorPlan, *, within: str = "") -> str:
    """Return the style of the areas, as in `rvsg world draw`, and of their names on a narrow screen.

    Args:
        within: The selector of the element that holds the plan, on a page with several.
    """
    at = f"{within} " if within else ""
    kinds = (area.kind for area in world.areas)
    names = list(dict.fromkeys(kinds))
    rules = []
    for ink, wrap in ((LIGHT, "{}"), (DARK, "@media (prefers-color-scheme: dark){{{}}}")):
        colours = ink.kind_colours(names).values()
        tints = "".join(
            f"{at}.plan .kind-{place}{{fill:{css};stroke:{css};fill-opacity:{ink.tint}}}"
            for place, css in enumerate("#{:02x}{:02x}{:02x}".format(*colour) for colour in colours)
        )
        rules.append(wrap.format(tints))
    size = narrow_size(floor)
    words = ",".join(f"{at}{each}" for each in (".still .area-name", ".map .area-name", ".pin text"))
    rules.append(
        f"@media (max-width:640px){{{words}{{font-size:{size:.3f}px}}{at}.pin circle{{r:{0.8 * size:.3f}px}}}}"
    )
    return "".join(rules)
