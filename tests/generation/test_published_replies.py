"""Verbatim replies and configurations of the published study: found, decoded, and what is invalid in them listed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from tests.published_data import published_data

from rvsg.generation.replies import read_configuration, read_description
from rvsg.generation.reply_json import find_json
from rvsg.scenario.scenario import Mission
from rvsg.scenario.validity import check
from rvsg.world.world import World

_FOLDER = published_data()
DATA = _FOLDER / "published" if _FOLDER else None
pytestmark = pytest.mark.skipif(DATA is None, reason="the published data is not at hand")


def replies() -> list[str]:
    files = sorted((DATA / "replies").glob("*/route_1/*.jsonl"))
    return [json.loads(line)["reply"] for file in files for line in file.read_text().splitlines()]


def configurations() -> list[tuple[Path, dict[str, Any]]]:
    files = sorted(DATA.glob("*/route_*/*/*.json"))
    return [(f, json.loads(f.read_text())) for f in files if not {"scenario", "memory"} & set(f.stem.split("_"))]


def test_every_json_in_the_verbatim_replies_is_found_and_nothing_else() -> None:
    counted = {"configurations": 0, "descriptions": 0, "prose": 0}
    for reply in replies():
        found = find_json(reply)
        assert len(found) == reply.count("```json"), reply[:200]
        assert not any(one.repaired for one in found)
        if not found:
            counted["prose"] += 1
        elif read_configuration(reply).people is not None:
            counted["configurations"] += 1
            assert not read_configuration(reply).findings
        else:
            counted["descriptions"] += 1
            assert len(read_description(reply)) > 100
    assert counted == {"configurations": 160, "descriptions": 42, "prose": 377}


def test_every_published_configuration_decodes_to_exactly_its_tasks_and_paths() -> None:
    empty = 0
    for file, value in configurations():
        reply = read_configuration(file.read_text())
        expected = [[(t["Task"], tuple(t["Path"])) for t in tasks] for tasks in value.values() if tasks]
        if reply.people is None:
            assert expected == []
        else:
            assert [[(t.name, t.path) for t in h.tasks] for h in reply.people.humans] == expected
        lost = [finding for finding in reply.findings if finding.rule == "no-tasks"]
        empty += len(lost)
        assert len(lost) == len(reply.findings) - (reply.people is None and not lost)
        assert len(lost) == sum(not tasks for tasks in value.values())
    assert empty == 3


@pytest.mark.exhaustive
def test_every_unknown_waypoint_of_the_published_configurations_is_listed(warehouse: World) -> None:
    listed = named = 0
    for file, value in configurations():
        people = read_configuration(file.read_text()).people
        if people is None:
            continue
        route = warehouse.route(next(part for part in file.parts if part.startswith("route_")))
        mission = Mission(world="warehouse", world_id=warehouse.id, route=route)
        listed += sum(f.rule in ("unknown-waypoint", "invalid-waypoint") for f in check(people, mission, warehouse))
        names = [name for tasks in value.values() for task in tasks for name in task["Path"]]
        named += sum(name not in warehouse.grid.valid for name in names)
    assert listed == named
    assert named > 200
