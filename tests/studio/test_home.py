"""Home, and what holds for every page: the token, no network, hostile text, restarts."""

from __future__ import annotations

import contextlib
import http.client
import shutil
from urllib.parse import urlsplit

from tests.studio.conftest import HOSTILE, Server, Show, waited

import rvsg
from rvsg.app.view import write_view
from rvsg_studio.listing import Lister
from rvsg_studio.workspace import notes_of


def status(server: Server, path: str, **headers: str) -> int:
    with contextlib.closing(http.client.HTTPConnection(urlsplit(server.address).netloc, timeout=20)) as connection:
        connection.request("GET", path, headers=headers)
        with connection.getresponse() as answer:
            return answer.status


def test_a_second_user_without_the_token_gets_403(studio: Server) -> None:
    for path in ("/", "/files/look.css", "/data/replay?campaign=runs/first&attempt=0", "/nowhere"):
        assert status(studio, path) == 403
    upgrade = {"Connection": "Upgrade", "Upgrade": "websocket", "Sec-WebSocket-Version": "13"}
    socket = "/_nicegui_ws/socket.io/?EIO=4&transport=websocket"
    assert status(studio, socket, **upgrade, **{"Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ=="}) == 403
    assert status(studio, "/_nicegui_ws/socket.io/?EIO=4&transport=polling") == 403


def test_hostile_names_of_folders_stay_text(show: Show, studio: Server) -> None:
    name = HOSTILE.replace("/", "\u2044")
    shutil.copytree(studio.folder / "runs" / "first", studio.folder / "runs" / name)
    tab = show()
    assert tab.get_by_role("link", name=f"runs/{name}").count() == 1
    assert tab.locator("main img[src=x], main script").count() == 0


def test_failures_of_all_campaigns_are_ranked_filtered_marked_and_kept(show: Show, studio: Server) -> None:
    first = studio.folder / "runs" / "first"
    shutil.copytree(first, studio.folder / "runs" / "second")
    answer = rvsg.Campaign.open(first).answer
    names = [row.name for row in answer.failures]
    tab = show()
    rows = tab.locator(".st-failures tbody tr")
    waited(lambda: rows.count() == 2 * len(names) > 0)
    assert rows.first.get_by_role("link").inner_text() == names[0]
    assert answer.failures[0].share in rows.first.inner_text()
    waited(lambda: tab.evaluate("[...document.querySelectorAll('.st-thumb img')].every(e => e.naturalWidth > 0)"))
    tab.keyboard.press("/")
    tab.keyboard.type("runs/second")
    waited(lambda: rows.count() == len(names))
    rows.first.get_by_role("checkbox").check()
    tab.get_by_role("button", name="Compare", exact=True).click()
    tab.get_by_text("Select failures of two campaigns").wait_for()
    tab.get_by_role("button", name="Add to suite").click()
    tab.get_by_text("suite holds 1 case.").wait_for()
    suite = rvsg.Suite.open(studio.folder / "suite")
    assert [case.title for case in suite.cases] == [names[0]]
    tab.get_by_label("Status of the selection").select_option("known")
    waited(lambda: rows.first.get_by_text("known").count() == 1)
    assert [each.status for each in notes_of(studio.folder / "runs" / "second").findings.values()] == ["known"]
    tab.get_by_label("Status", exact=True).select_option("new")
    tab.get_by_text("No failure has all of this.").or_(rows.first).first.wait_for()
    waited(lambda: rows.count() == len(names) - 1)


def test_contact_ranks_before_any_violation_without(studio: Server) -> None:
    found = Lister(studio.folder).listing().campaigns[0].failures[0]
    kinds = {"touch": (1, "no", "rarely"), "always": (0, "yes", "always"), "open": (0, "open", "not settled")}
    made = {
        name: found.replace(row=found.row.replace(contacts=contacts, violated=violated, often=often))
        for name, (contacts, violated, often) in reversed(kinds.items())
    }
    assert sorted(made, key=lambda name: made[name].severity, reverse=True) == list(kinds)


def test_an_empty_folder_offers_three_starts(show: Show, studio: Server) -> None:
    shutil.rmtree(studio.folder / "runs")
    tab = show()
    assert tab.locator(".st-cards a").all_inner_texts() == ["New campaign", "New world", "New scenario"]


def test_campaigns_of_a_matrix_are_one_row(show: Show, studio: Server) -> None:
    folder = studio.folder / "runs"
    shutil.copytree(folder / "first", folder / "all" / "one")
    shutil.copytree(folder / "first", folder / "all" / "two")
    (folder / "all" / "matrix.json").write_text("{}")
    tab = show()
    row = tab.locator("tr", has=tab.get_by_role("link", name="runs/all", exact=True))
    assert row.locator("a.chip").count() == 2


def test_a_rvsg_file_that_is_dropped_on_home_opens_as_a_campaign(show: Show, studio: Server) -> None:
    first = studio.folder / "runs" / "first"
    write_view(first, studio.folder.parent / "sent.rvsg")
    tab = show()
    field = tab.locator("[data-studio=view][data-ready] input")
    field.set_input_files(studio.folder.parent / "sent.rvsg")
    tab.get_by_text(rvsg.Campaign.open(first).answer.headline).first.wait_for()
    assert (studio.folder / "received" / "sent" / "ledger.sqlite").is_file()
    studio.refuses = True
    tab.goto(studio.base)
    field.set_input_files(studio.folder.parent / "sent.rvsg")
    tab.get_by_text("is there already").wait_for()
