"""Requests that no page sends: each is answered with a reason, none with an error of the studio itself."""

from __future__ import annotations

import json
import shutil
from typing import Any

import pytest

import rvsg
from rvsg.scenario.builder import save_scenario
from rvsg.world.edits import CHANGES as EDITS
from rvsg_studio.question import Question
from rvsg_studio.workspace import Workspace
from rvsg_studio.world_editor import folder_of_world

pytest.importorskip("nicegui", reason="nicegui is not installed")
from fastapi import FastAPI
from starlette.testclient import TestClient

from rvsg_studio.answers import ANSWERS, CHANGES, add_data

DEEP = "[" * 5000 + "]" * 5000
BODIES = ("", "{", "[]", '"x"', DEEP, f'{{"change":{DEEP}}}', '{"page": "\\ud800"}', '{"t": NaN}', '{"attempt": 1e999}',
          '{"fields": {"a": NaN}}', '{"unknown": 1}', b"\xff\xfe")  # fmt: skip
VALUES = (None, True, -1, 10**30, "a\0b", "../..", "/etc/passwd", "loop", "z" * 5000, "nan", "2001-13-45", [], [[]],
          "[" * 3000, {}, {"a": 1}, {"what": ["x"]})  # fmt: skip


@pytest.fixture(scope="module")
def workspace(tmp_path_factory: pytest.TempPathFactory) -> Workspace:
    folder = tmp_path_factory.mktemp("work")
    shutil.copytree(folder_of_world("office"), folder / "office2")
    save_scenario(rvsg.scenario("warehouse", "route_1", [rvsg.walk("Worker", "E15", "H15")]), folder / "a.json")
    (folder / "loop").symlink_to("loop")
    made = Workspace(folder)
    made.jobs.start = pytest.fail  # type: ignore[assignment]
    return made


@pytest.fixture(scope="module")
def client(workspace: Workspace) -> Any:
    app = FastAPI()
    add_data(app, workspace)
    return TestClient(app)  # an error of the studio itself is raised here


def sent(client: Any, name: str, body: Any) -> Any:
    answer = client.post(f"/data/{name}", content=body, headers={"content-type": "application/json"})
    assert answer.status_code in (200, 400)
    assert answer.status_code == 200 or answer.json()["error"]
    return answer


@pytest.mark.parametrize("name", CHANGES)
def test_what_is_no_request_is_refused(client: Any, name: str) -> None:
    for body in BODIES:
        assert sent(client, name, body).status_code == 400


@pytest.mark.parametrize("name", [*ANSWERS, *CHANGES])
def test_any_value_is_answered(client: Any, name: str) -> None:
    base = {"world": "nowhere", "file": "a.json", "scenario": "a.json", "page": "p", "folder": ".", "job": "x"}
    for place, key in enumerate(Question.model_fields):  # every value at some key
        for value in (VALUES[place % len(VALUES)],):
            if name in ANSWERS:
                answer = client.get(f"/data/{name}", params=base | {key: str(value)})
                assert answer.status_code in (200, 400)
            else:
                sent(client, name, json.dumps(base | {key: value}))


@pytest.mark.parametrize("what", EDITS)
def test_any_change_of_a_world_is_answered(client: Any, workspace: Workspace, what: str) -> None:
    world = rvsg.load_world(workspace.folder / "office2")
    named = {"add area": "x", "add route": "x", "add door": "x"}.get(what)
    whole: dict[str, Any] = {
        "name": named or (world.routes[0].name if "route" in what else world.areas[0].name), "rectangle": [0, 0, 1, 1],
        "line": [[0, 0], [1, 1]], "other": world.areas[1].name, "points": [[0, 0], [1, 1]], "hinge": [0, 0],
        "end": [1, 0], "time_limit_s": 9, "values": ["a"] if "activities" in what else {"through": {"index": 0}},
    }  # fmt: skip
    place = workspace.folder / "office2"
    for key in whole:
        for value in (
            -1,
            [[]],
            "nan",
            "[" * 3000,
            {"name": [1], "rectangle": "x", "start": [[]]},
            {"through": {"index": 0, "pose": "x"}},
        ):
            sent(client, "world-edit", json.dumps({"world": "office2", "change": {**whole, "what": what, key: value}}))
        shutil.rmtree(place)
        shutil.copytree(folder_of_world("office"), place)


def test_what_is_typed_is_kept_whole_or_not_at_all(client: Any) -> None:
    assert sent(client, "typed-keep", '{"page": "q", "fields": {"a": "1"}}').status_code == 200
    assert sent(client, "typed-keep", '{"page": "q", "fields": {"a": NaN}}').status_code == 400
    assert client.get("/data/typed", params={"page": "q"}).json() == {"a": "1"}
