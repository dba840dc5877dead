"""A campaign and the results of a suite as one file, in the viewer and unpacked."""

from __future__ import annotations

import base64
import functools
import gzip
import http.server
import json
import shutil
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from tests.coded import coded

import rvsg
from rvsg.app.view import read_view, unpack_campaign, unpack_view, viewer_page, write_view
from rvsg.core.errors import FileError
from rvsg.world.world_folder import SHIPPED


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign's folder, its view, the view of results of a suite, and the viewer."""
    made = tmp_path_factory.mktemp("views")
    settings: dict[str, Any] = {"scenarios": 1, "refinements": 0, "repeats": 3, "confirmations": 6, "jobs": 1}
    campaign = rvsg.Campaign.create(made / "first", simulator="kinematic", **settings)
    list(campaign.run())
    write_view(made / "first", made / "other.rvsg")
    suite = rvsg.Suite.create(made / "suite").add(
        made / "first" / "best_scenario.json", title="<img src=x onerror=a()>"
    )
    (made / "results.json").write_text(suite.run(runs=2, version="one").model_dump_json(), encoding="utf-8")
    write_view(made / "results.json", made / "suite.rvsg")
    (made / "viewer.html").write_text(viewer_page(), encoding="utf-8")
    return made


def changed(folder: Path, **values: Any) -> bytes:
    """Return the campaign's view with other values."""
    view = json.loads(gzip.decompress((folder / "other.rvsg").read_bytes()))
    return gzip.compress(json.dumps({**view, **values}).encode())


def test_an_unpacked_view_is_the_campaign_it_was_made_of(folder: Path, tmp_path: Path) -> None:
    made = unpack_campaign(folder / "other.rvsg")
    opened, campaign = rvsg.Campaign.open(made), rvsg.Campaign.open(folder / "first")
    assert made == folder / "other" and opened.attempts() == campaign.attempts()
    assert "<h1" in opened.report().read_text(encoding="utf-8") and opened.answer.headline == campaign.answer.headline
    with pytest.raises(FileError, match="is there already"):
        unpack_view(folder / "other.rvsg")
    again = tmp_path / "again.rvsg"
    write_view(folder / "first", again)
    assert again.read_bytes() == (folder / "other.rvsg").read_bytes()


def test_a_world_of_its_own_goes_with_a_campaign(tmp_path: Path) -> None:
    shutil.copytree(SHIPPED / "office", tmp_path / "mine")
    kept = {"scenarios": 1, "refinements": 0, "repeats": 3, "confirmations": 0, "jobs": 1, "simulator": "kinematic"}
    route = rvsg.load_world("office").routes[0].name
    list(rvsg.Campaign.create(tmp_path / "first", world=str(tmp_path / "mine"), route=route, **kept).run())
    write_view(tmp_path / "first", tmp_path / "a.rvsg")
    shutil.rmtree(tmp_path / "mine")
    shutil.rmtree(tmp_path / "first")
    assert rvsg.Campaign.open(unpack_campaign(tmp_path / "a.rvsg")).report().is_file()


WRONG: dict[str, Any] = {
    "is no .rvsg file": lambda folder: b"PK no gzip",
    "is no .rvsg": lambda folder: gzip.compress(b"[1]"),
    "damaged or cut off": lambda folder: (folder / "other.rvsg").read_bytes()[:-100],
    "has version 9": lambda folder: changed(folder, version=9),
    "is damaged": lambda folder: changed(folder, page=5),
    "cannot be shown": lambda folder: changed(folder, page='<main></main><script id="data">{"groups": [{}]}</script>'),
}
"""What the viewer says of files that are none, by the words of its message."""


@pytest.mark.parametrize("words", list(WRONG)[:5])
def test_a_file_that_is_no_view_is_refused_in_a_sentence(folder: Path, tmp_path: Path, words: str) -> None:
    (tmp_path / "x.rvsg").write_bytes(WRONG[words](folder))
    with pytest.raises(FileError, match=words if words != "is damaged" else "page"):
        unpack_view(tmp_path / "x.rvsg")
    assert [path.name for path in tmp_path.iterdir()] == ["x.rvsg"]


@pytest.mark.parametrize("name", ["../a", "/tmp/a", "inputs/../../a", "inputs/.x", "vlm/a\\0", "report.html", "a.py"])
def test_no_file_of_a_view_leaves_its_folder(folder: Path, tmp_path: Path, name: str) -> None:
    (tmp_path / "x.rvsg").write_bytes(changed(folder, files={name: "QQ=="}))
    with pytest.raises(FileError, check=coded("view-damaged")):
        unpack_view(tmp_path / "x.rvsg")
    assert [path.name for path in tmp_path.iterdir()] == ["x.rvsg"]


def test_a_view_without_files_is_refused(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "x.rvsg").write_bytes(changed(folder, files={}))
    with pytest.raises(FileError, match="files"):
        unpack_view(tmp_path / "x.rvsg")


def test_a_view_that_unpacks_to_too_much_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rvsg.app.view.LARGEST", 1000)
    (tmp_path / "x.rvsg").write_bytes(gzip.compress(b" " * 2000))
    with pytest.raises(FileError, match="more than 1,000 bytes"):
        read_view(tmp_path / "x.rvsg")


def test_the_results_of_a_suite_are_a_view_too(folder: Path) -> None:
    assert read_view(folder / "suite.rvsg").page.count("&lt;img src=x onerror=a()&gt;") == 1
    with pytest.raises(FileError, check=coded("view-suite")):
        unpack_campaign(folder / "suite.rvsg")
    assert (unpack_view(folder / "suite.rvsg", folder / "got") / "results.json").is_file()


@pytest.mark.parametrize("source", [".", "suite"])
def test_a_folder_without_a_campaign_is_not_exported(folder: Path, tmp_path: Path, source: str) -> None:
    with pytest.raises(FileError, match="holds no campaign"):
        write_view(folder / source, tmp_path / "x.rvsg")


OWN = ("file:", "data:")


@pytest.fixture
def tab(browser: Any, folder: Path) -> Iterator[Any]:
    """The viewer in a tab; a script's error, a dialog, or a request that its policy does not block fails the test."""
    context = browser.new_context()
    tab, wrong = context.new_page(), list[str]()
    tab.on("pageerror", lambda error: wrong.append(f"error: {error}"))
    tab.on("requestfinished", lambda request: wrong.append(request.url) if request.url[:5] not in OWN else None)
    tab.on("requestfailed", lambda request: wrong.append(request.url) if request.failure != "csp" else None)
    tab.on("dialog", lambda dialog: (wrong.append(dialog.message), dialog.dismiss()))
    tab.goto((folder / "viewer.html").as_uri())
    yield tab
    context.close()
    assert wrong == []


def test_the_viewer_shows_the_page_of_a_file_and_then_another(tab: Any, folder: Path) -> None:
    tab.set_input_files("#file", folder / "other.rvsg")
    tab.wait_for_function("() => window.replay && window.replay.state().run")
    answer = rvsg.Campaign.open(folder / "first").answer
    assert answer.headline in tab.locator("h1").inner_text()
    assert tab.evaluate("replay.state().run") == answer.rows[0].run
    assert tab.locator(".ranking .filter, .filter").count() > 0 and tab.locator("#map .rp-robot").count() == 1
    tab.set_input_files("#file", folder / "suite.rvsg")
    tab.locator("h1", has_text="one").wait_for()
    assert tab.locator("#content img").count() == 0 and "<img src=x" in tab.locator("summary").inner_text()
    assert tab.evaluate("window.replay") is None


def test_a_file_can_be_dropped(tab: Any, folder: Path) -> None:
    data = base64.b64encode((folder / "other.rvsg").read_bytes()).decode()
    tab.evaluate(
        """data => {
          const bytes = Uint8Array.from(atob(data), each => each.charCodeAt(0)), dropped = new DataTransfer();
          dropped.items.add(new File([bytes], "mine.rvsg"));
          const how = { bubbles: true, cancelable: true, dataTransfer: dropped };
          document.body.dispatchEvent(new DragEvent("drop", how));
        }""",
        data,
    )
    tab.wait_for_function("() => window.replay && document.getElementById('note').textContent === 'mine.rvsg'")


@pytest.mark.parametrize("words", WRONG)
def test_the_viewer_says_why_a_file_does_not_open(tab: Any, folder: Path, tmp_path: Path, words: str) -> None:
    (tmp_path / "x.rvsg").write_bytes(WRONG[words](folder))
    tab.set_input_files("#file", tmp_path / "x.rvsg")
    tab.wait_for_function("words => document.getElementById('note').textContent.includes(words)", arg=words)
    assert tab.locator("#content").inner_html() == ""


HOSTILE = """<style>@import "https://a.org/a.css"; main { background: url(https://a.org/a.png) }</style>
<main onclick="alert(1)"><h1>Hostile</h1><script>alert(2)</script><img src=x onerror="alert(3)">
<iframe srcdoc="<script>alert(4)</script>"></iframe><a id="out" href="javascript:alert(5)">a</a>
<a href="https://a.org">b</a><form action="https://a.org"><input autofocus></form>
<svg onload="alert(6)"><image href="https://a.org/a.png"/><foreignObject><img src=x></foreignObject>
<animate attributeName="href"/></svg><object data="https://a.org"></object>
<meta http-equiv="refresh" content="0;url=https://a.org"><base href="https://a.org"></main>"""


def test_a_hostile_page_runs_nothing_and_loads_nothing(tab: Any, folder: Path, tmp_path: Path) -> None:
    (tmp_path / "x.rvsg").write_bytes(changed(folder, page=HOSTILE))
    tab.set_input_files("#file", tmp_path / "x.rvsg")
    tab.locator("h1", has_text="Hostile").click()
    tab.locator("#out").click()
    found = tab.evaluate(
        "Array.from(document.querySelectorAll('#content *'), each => each.outerHTML.match(/^<[^>]*>/)[0])"
    )
    assert found == ["<main>", "<h1>", '<a id="out">', "<a>", "<svg>", "<image>"]


def test_a_file_of_the_same_server_opens_by_its_address(browser: Any, folder: Path) -> None:
    served = functools.partial(http.server.SimpleHTTPRequestHandler, directory=str(folder))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), served) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        context = browser.new_context()
        tab, base = context.new_page(), f"http://127.0.0.1:{server.server_port}/viewer.html"
        tab.goto(f"{base}?file=other.rvsg#t=1")
        tab.wait_for_function("() => window.replay && window.replay.state().run")
        tab.goto(f"{base}?file=none.rvsg")
        tab.get_by_text("There is no file at none.rvsg.").wait_for()
        tab.goto(f"{base}?file=https://example.org/other.rvsg")
        tab.get_by_text("Only files of the same server").wait_for()
        context.close()
        server.shutdown()
