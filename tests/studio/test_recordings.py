"""A recording is dropped on the studio, inspected, made a scenario, and shown beside it."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from tests.studio.conftest import PATIENT, Server, Show, axe_violations, fits
from tests.studio.test_every_page import LOOK, OTHER_LOOKS

import rvsg
from rvsg.scenario.builder import load_scenario_in
from rvsg_studio.pages.recording import recordings_in
from rvsg_studio.workspace import Workspace, receive_recording


@pytest.fixture(scope="module")
def tracks(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The tracks of a simulated drive among two people, as a table."""
    world = rvsg.load_world("warehouse")
    scenario = rvsg.propose(world, "route_1", "R1", humans=2, seed=3).scenario
    assert scenario is not None
    path = rvsg.simulate(scenario, [1], world=world)[0].trajectory
    rows = [
        f"robot,{t:.3f},{x:.4f},{y:.4f},{yaw:.4f},world"
        for t, x, y, yaw in zip(path.t, path.x, path.y, path.yaw, strict=True)
    ]
    for k in range(2):
        rows += [
            f"p{k},{t:.3f},{x:.4f},{y:.4f},{yaw:.4f},world"
            for t, x, y, yaw in zip(path.t, path.human_x[:, k], path.human_y[:, k], path.human_yaw[:, k], strict=True)
        ]
    file = tmp_path_factory.mktemp("tracks") / "incident.csv"
    file.write_text("id,t,x,y,yaw,frame\n" + "\n".join(rows))
    return file


def is_well(tab: Any) -> None:
    assert axe_violations(tab) == []
    assert fits(tab)


@pytest.mark.parametrize("look", [LOOK, *(pytest.param(each, marks=pytest.mark.exhaustive) for each in OTHER_LOOKS)])
def test_a_recording_becomes_a_scenario(
    show: Show, browser: Any, studio: Server, tracks: Path, look: tuple[int, str]
) -> None:
    tab = show("/recording", width=look[0], color_scheme=look[1], bypass_csp=True)
    is_well(tab)
    tab.get_by_label("Drop a recording here").set_input_files(tracks)
    tab.wait_for_url("**/recording?file=recordings%2Fincident.csv")
    tab.get_by_label("World").select_option("office")
    tab.get_by_role("button", name="Inspect").click()
    tab.get_by_text("The robot is in obstacles of office or off its map").wait_for()
    tab.get_by_label("World").select_option("warehouse")
    tab.get_by_role("button", name="Inspect").click()
    tab.get_by_text("After cleaning, seconds of the drive: p0").wait_for()
    tab.get_by_label(re.compile("^People")).select_option("as-recorded")
    tab.get_by_role("button", name="Make the scenario").click()
    tab.locator("[data-studio=replay][data-ready]").wait_for(timeout=PATIENT)
    tab.get_by_text("of 5 runs keep the smallest gap within 0.1 m").wait_for()
    assert tab.get_by_text(re.compile("^seed [0-4]: ")).count() == 5
    times = "[...document.querySelectorAll('[data-studio=replay]')].map(each => each.replayData.groups[0].runs.length)"
    assert tab.evaluate(times) == [2]
    tab.get_by_text("The same on the command line").press("Enter")
    command = (
        "rvsg recording scenario recordings/incident.csv --world warehouse --robot tiago_omni --people as-recorded"
    )
    tab.get_by_text(command).first.wait_for()
    is_well(tab)
    scenario, world = load_scenario_in(studio.folder / "scenarios" / "incident.json")
    assert world.name == "warehouse" and len(scenario.people.humans) == 2
    written = browser.new_page(viewport={"width": look[0], "height": 900}, color_scheme=look[1], bypass_csp=True)
    written.goto((studio.folder / "scenarios" / "incident.html").as_uri())
    written.get_by_text("incident.csv").first.wait_for()
    written.locator(".rp-map").first.wait_for()
    is_well(written)
    written.close()
    tab.get_by_role("link", name="Open in the editor").click()
    tab.wait_for_url("**/scenario?file=scenarios%2Fincident.json")


def test_a_recording_without_a_map_is_rebuilt_on_an_open_floor(
    show: Show, browser: Any, studio: Server, tracks: Path
) -> None:
    name = "front_interaction_of_the_morning_01"
    (studio.folder / f"{name}.csv").write_bytes(tracks.read_bytes())
    tab = show(f"/recording?file={name}.csv&world=warehouse", bypass_csp=True)
    tab.get_by_role("button", name="Make the scenario").wait_for()
    assert tab.get_by_label("Floor").count() == 0, "a world is given"
    tab = show(f"/recording?file={name}.csv", width=390, bypass_csp=True)
    tab.get_by_label("Floor").select_option("open")
    is_well(tab)
    tab.get_by_role("button", name="Make the scenario").click()
    tab.locator("[data-studio=replay][data-ready]").wait_for(timeout=PATIENT)
    tab.get_by_text("The same on the command line").press("Enter")
    tab.get_by_text("--requirement R1 --open-floor").first.wait_for()
    assert load_scenario_in(studio.folder / "scenarios" / f"{name}.json")[1].name == f"{name}-world"
    written = browser.new_page(viewport={"width": 390, "height": 844}, bypass_csp=True)
    written.goto((studio.folder / "scenarios" / f"{name}.html").as_uri())
    written.locator(".rp-map").first.wait_for()
    is_well(written)
    written.close()


def test_recordings_of_the_folder_are_listed_and_none_is_replaced(tmp_path: Path) -> None:
    workspace = Workspace(tmp_path)
    (tmp_path / "bag").mkdir()
    for name in ("bag/metadata.yaml", "bag/bag_0.mcap", "one.mcap", "notes.md"):
        (tmp_path / name).write_text("")
    assert receive_recording(workspace, "../a b.csv", b"x")["address"] == "/recording?file=recordings%2Fa+b.csv"
    assert recordings_in(workspace) == ["bag", "one.mcap", "recordings/a b.csv"]
    receive_recording(workspace, "a b.csv", b"x")
    for name, content in (("a b.csv", b"y"), (".csv", b"x")):
        with pytest.raises(rvsg.RvsgError):
            receive_recording(workspace, name, content)
