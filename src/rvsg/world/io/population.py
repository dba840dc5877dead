"""Expand `<population>` into the models it stands for, each with its pose."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from rvsg.core.documents import Problem
from rvsg.core.seeds import stream
from rvsg.world.io.safe_xml import Element
from rvsg.world.io.sdf_shapes import numbers

MOST_MODELS = 1000


def expanded(
    population: Element, path: Path, problems: list[Problem]
) -> Iterator[tuple[Element, tuple[float, float, float]]]:
    """Yield the `<model>` or `<include>` of a population once per copy, with its position relative to the population.

    Gazebo draws `random` and `uniform` populations again at every start. Here they are drawn from a seed that follows
    from the population's name, so the same file always gives the same world.
    """
    template = next((child for child in population.children if child.tag in ("model", "include")), None)
    if template is None:
        problems.append(Problem(path, population.line, "the <population> holds no <model>", code="sdf-empty"))
        return
    for number, place in enumerate(_places(population, path, problems)):
        name = f"{_name(template)}_clone_{number}"
        copy = Element(template.tag, dict(template.attributes), template.line, template.text, list(template.children))
        if copy.tag == "model":
            copy.attributes["name"] = name
        else:
            copy.children = [child for child in copy.children if child.tag != "name"]
            copy.children.append(Element("name", {}, template.line, text=name))
        yield copy, place


def _name(template: Element) -> str:
    return template.attributes.get("name") or template.text_of("name") or template.text_of("uri").rpartition("/")[2]


def _places(population: Element, path: Path, problems: list[Problem]) -> list[tuple[float, float, float]]:
    """Return the position of every copy relative to the population, in metres."""
    distribution = population.find("distribution")
    kind = distribution.text_of("type", "random") if distribution is not None else "random"
    if kind == "grid" and distribution is not None:
        rows, columns = (max(1, int(_number(distribution, tag, 1.0, path, problems))) for tag in ("rows", "cols"))
        step = distribution.find("step")
        dx, dy, _ = numbers(step.text.strip(), 3, step, path, problems) if step is not None else (1.0, 1.0, 0.0)
        if rows * columns > MOST_MODELS:
            problems.append(
                Problem(path, population.line, f"the <population> has more than {MOST_MODELS} models", code="sdf-count")
            )
            return []
        return [
            ((column - (columns - 1) / 2) * dx, (row - (rows - 1) / 2) * dy, 0.0)
            for row in range(rows)
            for column in range(columns)
        ]
    count = int(_number(population, "model_count", 1.0, path, problems))
    if not 0 <= count <= MOST_MODELS:
        problems.append(
            Problem(path, population.line, f"<model_count> must be 0 to {MOST_MODELS}, got {count}", code="sdf-count")
        )
        return []
    if kind.startswith("linear-"):
        axis = "xyz".find(kind[-1])
        size = _region(population, path, problems)[1]
        along = (np.arange(count) + 0.5) / max(count, 1) - 0.5
        return [tuple(float(a * size[i]) if i == axis else 0.0 for i in range(3)) for a in along]  # type: ignore[misc]
    return _drawn(population, count, path, problems)


def _drawn(population: Element, count: int, path: Path, problems: list[Problem]) -> list[tuple[float, float, float]]:
    shape, size = _region(population, path, problems)
    draw = stream(0, f"population {population.attributes.get('name', '')}")
    places = []
    for u, v, w in draw.random((count, 3)):
        if shape == "cylinder":
            radius, angle = size[0] / 2 * math.sqrt(u), math.tau * v
            places.append((radius * math.cos(angle), radius * math.sin(angle), float((w - 0.5) * size[2])))
        else:
            places.append((float((u - 0.5) * size[0]), float((v - 0.5) * size[1]), float((w - 0.5) * size[2])))
    return places


def _region(population: Element, path: Path, problems: list[Problem]) -> tuple[str, list[float]]:
    """Return the shape and the size in metres of the region that a population fills."""
    box, cylinder = population.find("box"), population.find("cylinder")
    if box is not None and (size := box.find("size")) is not None:
        return "box", numbers(size.text.strip(), 3, size, path, problems)
    if cylinder is not None:
        radius, length = (_number(cylinder, tag, 1.0, path, problems) for tag in ("radius", "length"))
        return "cylinder", [2 * radius, 2 * radius, length]
    return "box", [1.0, 1.0, 1.0]


def _number(parent: Element, tag: str, otherwise: float, path: Path, problems: list[Problem]) -> float:
    child = parent.find(tag)
    return numbers(child.text.strip(), 1, child, path, problems)[0] if child is not None else otherwise
