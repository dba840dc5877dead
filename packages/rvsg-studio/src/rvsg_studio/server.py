"""The server of a studio on 127.0.0.1, and the guard that admits only who knows its token."""

from __future__ import annotations

import contextlib
import hashlib
import hmac
import logging
import os
import secrets
import socket
import threading
import webbrowser
from collections.abc import Awaitable, Callable, MutableMapping
from http.cookies import CookieError, SimpleCookie
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl, quote, urlencode

from rvsg.app.view import SUFFIX, unpack_view
from rvsg.core import plugins
from rvsg.core.errors import FileError, InputError, how_to_install
from rvsg.core.files import write_whole
from rvsg_studio.workspace import Workspace, own_folder

HOST = "127.0.0.1"
PORT = 8420
"""The port that is tried first where none is asked for."""
RECONNECT_S = 60.0


def serve(folder: Path, *, port: int | None, browser: bool, say: Callable[[str], None]) -> None:
    """Serve the studio of a folder, or of an unpacked `.rvsg` file, until it is interrupted.

    Args:
        port: the port; 0 is any free one, None the usual one or, where that is taken, any free one.
        browser: whether to open the address in the browser of this machine.

    Raises:
        InputError: NiceGUI is not installed, or the port is taken.
        FileError: the folder is missing or cannot be written.
    """
    if folder.suffix == SUFFIX and folder.is_file():
        folder = unpack_view(folder)
    if not folder.is_dir():
        raise FileError(folder, "this is no folder. Name an existing one: rvsg studio DIR")
    os.chdir(folder)  # relative paths of settings and command lines are read from the folder of the studio
    folder = Path.cwd()
    with _listening(port) as sock:
        number = sock.getsockname()[1]
        token = token_of(own_folder(folder))
        app = make_app(folder, token=token, port=number)
        address = f"http://{HOST}:{number}/?token={token}"
        say(f"Studio of {folder}: {address}")
        say("Whoever knows this address can use the studio. Ctrl-C ends it; jobs go on.")
        if (brought := folder / ".rvsg-studio").exists():
            say(f"{brought} is not used: the studio keeps its own files in {own_folder(folder)}.")
        if browser:
            webbrowser.open(address)
        import uvicorn

        logging.getLogger("uvicorn.error").setLevel(logging.WARNING)
        config = uvicorn.Config(app, log_level="warning", access_log=False, ws="auto", timeout_graceful_shutdown=2)
        uvicorn.Server(config).run(sockets=[sock])


def token_of(own: Path) -> str:
    """Return the token of a studio, which its user alone can read: pages that are open live on after a restart."""
    path = own / "token"
    if not path.is_file() or path.stat().st_size == 0:
        write_whole(path, secrets.token_urlsafe(24))
    return path.read_text()


def make_app(folder: Path, *, token: str, port: int) -> Callable[..., object]:
    """Return the application of a studio, with its guard in front of everything."""
    os.environ["NICEGUI_STORAGE_PATH"] = str(own_folder(folder) / "nicegui")  # read when NiceGUI is imported
    try:
        from fastapi import FastAPI
        from nicegui import ui
    except ImportError:
        raise InputError(f"The studio needs NiceGUI: {how_to_install('studio')}") from None
    from rvsg_studio.answers import add_data

    workspace = Workspace(folder)
    threading.Thread(target=workspace.listing, daemon=True).start()  # so that the first page waits less
    app = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
    add_data(app, workspace)
    for name in plugins.names("page"):
        plugins.find("page", name)(workspace)
    ui.run_with(
        app,
        title="RVSG studio",
        language="en-US",
        dark=None,
        tailwind=False,
        reconnect_timeout=RECONNECT_S,
        show_welcome_message=False,
        favicon="data:,",
    )
    return Guard(app, token=token, port=port)


@contextlib.contextmanager
def _listening(port: int | None):  # type: ignore[no-untyped-def]
    """A socket that listens on the loopback interface alone."""
    last: OSError | None = None
    for number in (PORT, 0) if port is None else (port,):
        sock = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            sock.bind((HOST, number))
            sock.listen(128)
        except (OSError, OverflowError) as error:
            sock.close()
            last = error if isinstance(error, OSError) else OSError(0, str(error))
            continue
        with sock:
            yield sock
        return
    reason = last.strerror or last if last else "unknown"
    raise InputError(f"Port {port} of {HOST} cannot be used: {reason}. Choose another with --port, or 0 for any.")


Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

HEADERS = (
    (b"content-security-policy",
     b"default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; style-src 'self' 'unsafe-inline'; "
     b"img-src 'self' data:; font-src 'self' data:; connect-src 'self'; frame-ancestors 'none'; form-action 'self'; "
     b"base-uri 'none'; object-src 'none'"),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"x-frame-options", b"DENY"),
)  # fmt: skip
"""What every answer says: nothing is loaded from elsewhere, and no other page may hold this one in a frame."""
REFUSED = b"""<!doctype html>
<html lang="en"><meta name="viewport" content="width=device-width"><title>RVSG studio</title>
<style>:root{color-scheme:light dark}body{font:16px/1.5 system-ui,sans-serif;max-width:38em;margin:4em auto}</style>
<h1>This studio needs its address</h1>
<p>Open the address that <code>rvsg studio</code> printed, with the token in it. What you typed is kept.</p></html>
"""


class Guard:
    """An ASGI application in front of another: it asks for the token, the right host and the right origin.

    The token comes once in the address (`?token=`), then as a cookie. Browsers send a cookie to every port of a host,
    so the studio sets it under a host name of its own, `rvsg-XXXX.localhost`, which other users' pages cannot know.
    Host and origin are checked so that no other page can reach the studio, whatever name it gives to 127.0.0.1.
    """

    def __init__(self, app: App, *, token: str, port: int) -> None:
        self.app = app
        self.token = token
        self.own = f"rvsg-{hashlib.sha256(token.encode()).hexdigest()[:16]}.localhost:{port}"
        self.hosts = (f"127.0.0.1:{port}", f"localhost:{port}", self.own)
        self.cookie = f"rvsg-studio-{port}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer 403, set the cookie, or pass the request on."""
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        headers = {key.decode("latin-1").lower(): value.decode("latin-1") for key, value in scope["headers"]}
        query = dict(parse_qsl(scope.get("query_string", b"").decode("latin-1"), keep_blank_values=True))
        origins = {None, *(f"http://{host}" for host in self.hosts)}
        if headers.get("host") not in self.hosts or headers.get("origin") not in origins:
            await self._refuse(scope, send)
        elif self._is(self._of_cookie(headers)):
            await self.app(scope, receive, _with_headers(send))
        elif scope["type"] == "http" and scope["method"] == "GET" and self._is(query.pop("token", "")):
            await self._let_in(scope, query, send, own=headers["host"] == self.own)
        else:
            await self._refuse(scope, send)

    def _of_cookie(self, headers: dict[str, str]) -> str:
        try:
            cookies = SimpleCookie(headers.get("cookie", ""))
        except CookieError:
            return ""
        return cookies[self.cookie].value if self.cookie in cookies else ""

    def _is(self, token: str) -> bool:
        return hmac.compare_digest(token.encode(), self.token.encode())

    async def _let_in(self, scope: Scope, query: dict[str, str], send: Send, *, own: bool) -> None:
        """Send the browser to the studio's own host name; there set the cookie and take the token off the address."""
        # A path may hold line breaks, or begin like the name of another host.
        query = query if own else query | {"token": self.token}
        address = "/" + quote(scope["path"].lstrip("/\\")) + (f"?{urlencode(query)}" if query else "")
        cookie = f"{self.cookie}={self.token}; Path=/; HttpOnly; SameSite=Strict"
        head = [(b"location", (address if own else f"http://{self.own}{address}").encode()), *HEADERS]
        head += [(b"set-cookie", cookie.encode())] if own else []
        await send({"type": "http.response.start", "status": 303, "headers": head})
        await send({"type": "http.response.body", "body": b""})

    async def _refuse(self, scope: Scope, send: Send) -> None:
        if scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008})  # before it is accepted: the server answers 403
            return
        head = [(b"content-type", b"text/html; charset=utf-8"), *HEADERS]
        await send({"type": "http.response.start", "status": 403, "headers": head})
        await send({"type": "http.response.body", "body": REFUSED})


def _with_headers(send: Send) -> Send:
    async def sending(message: MutableMapping[str, Any]) -> None:
        if message["type"] == "http.response.start":
            message = {**message, "headers": [*message.get("headers", ()), *HEADERS]}
        await send(message)

    return sending
