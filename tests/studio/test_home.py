"""Home, and what holds for every page: the token, no network, hostile text, restarts."""

from __future__ import annotations

import contextlib
import http.client
import shutil
from urllib.parse import urlsplit

from tests.studio.conftest import HOSTILE, Server, Show


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
    assert tab.locator("main img, main script").count() == 0
