"""Who gets in: token, host and origin, for pages, files and websockets alike."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from typing import Any

import pytest

from rvsg.core.errors import FileError
from rvsg.core.files import state_folder
from rvsg_studio.server import Guard, token_of
from rvsg_studio.workspace import Workspace, own_folder

PORT = 8420
HOST = f"127.0.0.1:{PORT}"
OWN = Guard(None, token="secret", port=PORT).own  # type: ignore[arg-type]
COOKIE = f"rvsg-studio-{PORT}=secret"


def ask(path: str = "/", *, query: str = "", kind: str = "http", method: str = "GET", **headers: str) -> dict[str, Any]:
    """What the guard answers; `inside` where the request came through to the application behind it."""
    sent: list[Any] = []

    async def inner(scope: Any, receive: Any, send: Any) -> None:
        await send({"type": "http.response.start", "status": 200, "headers": []})

    async def send(message: Any) -> None:
        sent.append(message)

    given = {"host": HOST} | headers
    scope = {
        "type": kind,
        "method": method,
        "path": path,
        "query_string": query.encode(),
        "headers": [(key.encode(), value.encode()) for key, value in given.items()],
    }
    asyncio.run(Guard(inner, token="secret", port=PORT)(scope, None, send))  # type: ignore[arg-type]
    return sent[0]


@pytest.mark.parametrize(
    "asked",
    [
        *({"path": path} for path in ("/", "/files/look.css", "/data/replay", "/_nicegui/x/static/nicegui.js", "/no")),
        *({"cookie": cookie} for cookie in ("", f"rvsg-studio-{PORT}=wrong", f"rvsg-studio-{PORT + 1}=secret")),
        {"cookie": "a;b=;=\x01"},
        *({"query": f"token={token}"} for token in ("", "wrong", "secret2", "\u00e4")),
        {"method": "POST", "query": "token=secret"},  # a change needs the cookie
        *({"cookie": COOKIE, "host": host} for host in ("evil.example", "evil.example:8420", "127.0.0.1")),
        {"cookie": COOKIE, "host": "127.0.0.1:1"},
        {"cookie": COOKIE, "origin": "https://evil.example"},
    ],
)
def test_without_the_token_or_from_another_host_everything_is_refused(asked: dict[str, str]) -> None:
    assert ask(**asked)["status"] == 403


def test_the_token_in_the_address_becomes_a_cookie_and_leaves_the_address() -> None:
    answer = ask("/campaign", query="folder=a%20b&token=secret", host=OWN)
    headers = dict(answer["headers"])
    assert answer["status"] == 303
    assert headers[b"location"] == b"/campaign?folder=a+b"
    assert b"secret" in headers[b"set-cookie"]
    assert b"HttpOnly" in headers[b"set-cookie"] and b"SameSite=Strict" in headers[b"set-cookie"]


def test_the_cookie_is_set_under_a_host_name_of_the_studio_alone() -> None:
    """A cookie of 127.0.0.1 goes to every port of it, also to the page of another user."""
    for host in (HOST, f"localhost:{PORT}"):
        headers = dict(ask("/campaign", query="folder=a&token=secret", host=host)["headers"])
        assert b"set-cookie" not in headers
        assert headers[b"location"] == f"http://{OWN}/campaign?folder=a&token=secret".encode()
    assert OWN.endswith(f".localhost:{PORT}") and Guard(None, token="other", port=PORT).own != OWN  # type: ignore[arg-type]


def test_what_a_folder_brings_is_neither_token_nor_job(tmp_path: Path) -> None:
    """Both have the authority of the user, so they lie with the user, where nobody else can write."""
    brought = tmp_path / "folder" / ".rvsg-studio"
    (brought / "jobs" / "20260101-000000-abcdef").mkdir(parents=True)
    (brought / "token").write_text("a" * 32)
    (brought / "token").chmod(0o600)
    job = {"kind": "campaign", "title": "", "command": "", "target": ".", "begun_s": 0.0, "arguments": {}}
    (brought / "jobs" / "20260101-000000-abcdef" / "job.json").write_text(json.dumps(job))
    own, other = own_folder(brought.parent), own_folder(tmp_path)
    assert own != other and own.stat().st_mode & 0o777 == 0o700 and not own.is_relative_to(tmp_path)
    token = token_of(own)
    assert len(token) == 32 and token != "a" * 32 and token_of(own) == token and token_of(other) != token
    (own / "token").write_text("")
    assert len(token_of(own)) == 32
    assert Workspace(brought.parent).jobs.all() == []


@pytest.mark.parametrize("wrong", ["relative", "written by others", "a link", "a file"])
def test_state_that_others_can_write_is_no_state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, wrong: str) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setenv("XDG_STATE_HOME", "state" if wrong == "relative" else str(tmp_path / "state"))
    folder = tmp_path / "state" / "rvsg"
    folder.mkdir(parents=True)
    if wrong == "relative":
        assert state_folder() == tmp_path / "home" / ".local" / "state" / "rvsg"
        return
    if wrong == "written by others":
        folder.chmod(0o777)
    else:
        folder.rename(tmp_path / "elsewhere")
        folder.symlink_to(tmp_path / "elsewhere") if wrong == "a link" else folder.touch()
    with pytest.raises(FileError) as caught:
        state_folder()
    assert caught.value.code == "state-folder"


@pytest.mark.parametrize(
    ("path", "location"),
    [
        ("//evil.example", b"/evil.example"),
        ("///evil.example/", b"/evil.example/"),
        ("/\\evil.example", b"/evil.example"),
        ("/a\r\nX: y", b"/a%0D%0AX%3A%20y"),
    ],
)
def test_the_token_does_not_lead_to_another_site(path: str, location: bytes) -> None:
    assert dict(ask(path, query="token=secret", host=OWN)["headers"])[b"location"] == location


def test_with_the_cookie_the_page_comes_with_its_policy() -> None:
    answer = ask(cookie=COOKIE)
    assert answer["status"] == 200
    assert b"default-src 'self'" in dict(answer["headers"])[b"content-security-policy"]
    assert ask(method="POST", cookie=COOKIE)["status"] == ask(cookie=COOKIE, origin=f"http://{OWN}")["status"] == 200


@pytest.mark.parametrize("asked", [{"cookie": COOKIE, "origin": "https://evil.example"}, {"query": "token=secret"}])
def test_a_websocket_of_another_origin_or_without_the_cookie_is_closed_before_it_opens(asked: dict[str, str]) -> None:
    assert ask(kind="websocket", **asked)["type"] == "websocket.close"
