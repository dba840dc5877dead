"""What is wrong or suspicious in the labelled areas and the activities of a world."""

from __future__ import annotations

import difflib
from itertools import combinations

from rvsg.world.authoring.fixes import (
    cut_area,
    remove_area,
    rename_area,
    rename_in_activity,
    renew_waypoints,
)
from rvsg.world.authoring.named_areas import unknown_areas
from rvsg.world.authoring.remarks import Subject, listed_names
from rvsg.world.space import frame_of, world_map
from rvsg.world.world import Area

FAR_M = 3.0


def check_areas(s: Subject, parts: list[set[str]]) -> None:
    """Judge the labelled areas: their names, outlines and waypoints."""
    from shapely import Polygon

    if not s.world.areas:
        s.say(s.labels, "areas-none", "there are no labelled areas: tasks can only name waypoints", "areas")
    corners = frame_of(world_map(s.world)).corners
    inside_map = Polygon(corners)
    main = parts[0] if parts else set()
    seen: dict[str, str] = {}
    names = [area.name for area in s.world.areas]
    for index, area in enumerate(s.world.areas):
        shape = s.shapes[area.name]
        key = ("areas", index)
        alike = seen.setdefault(area.name.strip().casefold(), area.name)
        if alike != area.name:
            other = rename_area(area.name, area.name.strip(), names)
            message = f'"{area.name}" is easily taken for "{alike}"; give it another name'
            s.say(s.labels, "area-alike", message, *key, fix=other)
        if area.name != area.name.strip():
            other = rename_area(area.name, area.name.strip(), names)
            s.say(s.labels, "area-spaces", f'the name "{area.name}" begins or ends with a space', *key, fix=other)
        if area.name.strip() in s.world.grid.by_name:
            other = rename_area(area.name, f"{area.kind} {area.name.strip()}", names)
            message = f'"{area.name}" is also the name of a waypoint; give it another name'
            s.say(s.labels, "area-waypoint-name", message, *key, fix=other)
        outside = 1.0 - float(shape.intersection(inside_map).area) / float(shape.area)
        if outside > 0.999:
            x0, y0, x1, y1 = inside_map.bounds
            message = f'"{area.name}" lies outside the map, which spans x {x0:g} to {x1:g} and y {y0:g} to {y1:g}'
            s.say(s.labels, "area-outside", message, *key, serious=True, fix=remove_area(area.name))
            continue
        if outside > 0.05:
            fix = cut_area(area.name, shape, inside_map)
            s.say(
                s.labels, "area-partly-outside", f'{outside:.0%} of "{area.name}" lies outside the map', *key, fix=fix
            )
        _check_area_waypoints(s, index, area, main)
    for a, b in combinations(s.world.areas, 2):
        first, second = s.shapes[a.name], s.shapes[b.name]
        shared = float(first.intersection(second).area) / min(float(first.area), float(second.area))
        if shared > 0.9 and a.kind == b.kind:
            index = s.world.areas.index(b)
            message = f'"{b.name}" and "{a.name}" cover the same place'
            s.say(s.labels, "area-twice", message, "areas", index, fix=remove_area(b.name))


def _check_area_waypoints(s: Subject, index: int, area: Area, main: set[str]) -> None:
    from shapely import Point

    if not area.waypoints:
        message = (
            f'no waypoint reaches "{area.name}": none lies within {FAR_M:g} m of it. Move it, choose a finer grid, '
            "or name its waypoints"
        )
        s.say(s.labels, "area-no-waypoint", message, "areas", index, serious=True)
        return
    shape = s.shapes[area.name]
    away = {n: float(shape.distance(Point(*s.world.grid.position(n)))) for n in area.waypoints}
    far = [name for name, distance in away.items() if distance > FAR_M]
    if far:
        message = f'{listed_names(far)} of "{area.name}" lie{"s" * (len(far) == 1)} more than {FAR_M:g} m away from it'
        s.say(s.labels, "area-far-waypoints", message, "areas", index, "waypoints", fix=renew_waypoints(area.name))
    if main and not main & set(area.waypoints):
        message = f'"{area.name}" lies in a part of the map that people cannot walk to from the rest'
        s.say(s.labels, "area-isolated", message, "areas", index, serious=True)


def check_activities(s: Subject) -> None:
    """Judge the activities: the areas they name."""
    if not s.world.activities:
        s.say(
            s.head,
            "activities-none",
            "no activities are given (who does what between which areas): generators will guess",
        )
    known = [area.name.strip() for area in s.world.areas]
    for index, activity in enumerate(s.world.activities):
        for name in unknown_areas(activity, known):
            near = difflib.get_close_matches(name, known, n=1, cutoff=0.6)
            asked = f'; did you mean "{near[0]}"?' if near else ""
            message = f'the activity "{activity}" names "{name}", which is no labelled area{asked}'
            fix = rename_in_activity(s.world.activities, index, name, near[0]) if near else None
            s.say(s.head, "activity-unknown-area", message, "activities", index, fix=fix)
