"""Everything that is wrong or suspicious in a world folder, all at once, each with its file and line."""

from __future__ import annotations

from pathlib import Path

from rvsg.core.documents import DocumentError, Problem
from rvsg.core.errors import FileError
from rvsg.robots.robot import Robot
from rvsg.world.authoring.check_areas import check_activities, check_areas
from rvsg.world.authoring.check_grid import (
    check_aisles,
    check_isolated_floor,
    check_parts,
    check_size,
    check_unknown,
    reachable_parts,
    walk_hops,
)
from rvsg.world.authoring.check_routes import check_routes, drive_routes
from rvsg.world.authoring.remarks import Remark, Subject
from rvsg.world.authoring.trial import Trial
from rvsg.world.io.load import read_world, world_folder


def check_world(folder: str | Path, *, trial: Trial | None = None, robot: Robot | None = None) -> tuple[Remark, ...]:
    """Return all findings on a world folder: unreadable files first, then whatever can be judged of the rest.

    With a trial, every route is also driven and every hop walked in a simulator. With a robot the routes are checked as
    they are fitted to it.
    """
    folder = world_folder(folder)
    problems: list[Problem] = []
    try:
        world = read_world(folder, problems)
    except DocumentError as error:
        return tuple(Remark(problem=p, serious=True) for p in (*error.problems, *problems))
    except FileError as error:
        return (Remark(problem=Problem.of(error), serious=True),)
    found = [Remark(problem=p, serious=True) for p in problems]
    return (*found, *_judged(Subject(folder, world, trial, robot)))


def _judged(s: Subject) -> list[Remark]:
    parts = reachable_parts(s)
    check_areas(s, parts)
    check_routes(s)
    check_parts(s, parts)
    check_isolated_floor(s)
    check_aisles(s)
    check_unknown(s)
    check_size(s)
    check_activities(s)
    if s.trial is not None:
        drive_routes(s, s.trial)
        walk_hops(s, s.trial)
    return s.remarks
