"""The cycle of a person's tasks, which may begin on the way from one place to the next."""

from __future__ import annotations

from rvsg.scenario.scenario import Task


def begin_at(tasks: tuple[Task, ...], k: int, at: int) -> tuple[Task, ...]:
    """Return the cycle of tasks beginning at place `at` in the path of task `k`, and ending there."""
    if at == 0:
        return (*tasks[k:], *tasks[:k])
    task, here = tasks[k], tasks[k].path[at]
    start, end = ends_of(task)
    rest, begun = task.path[at:], task.path[: at + 1]
    first = Task.between(here, end, rest, tuple(p for p in task.pauses if p.at in rest[1:]))
    last = Task.between(start, here, begun, tuple(p for p in task.pauses if p.at in begun[1:]))
    return (first, *tasks[k + 1 :], *tasks[:k], last)


def at_places(tasks: tuple[Task, ...]) -> tuple[Task, ...]:
    """The cycle of tasks from place to place again, where it begins on the way through one of them."""
    first, last = tasks[0], tasks[-1]
    (begin, end), (start, close) = ends_of(first), ends_of(last)
    if len(tasks) < 3 or not begin == close == first.path[0]:
        return tasks
    path, pauses = (*last.path, *first.path[1:]), (*last.pauses, *first.pauses)
    return (Task.between(start, end, path, pauses), *tasks[1:-1])


def ends_of(task: Task) -> tuple[str, str]:
    """Return the areas, or else the waypoints, between which a task leads."""
    return task.start_area or task.path[0], task.end_area or task.path[-1]
