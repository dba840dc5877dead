"""Serve a studio on 127.0.0.1 behind a token."""

from __future__ import annotations

import contextlib
import logging
import os
import secrets
import socket
import threading
import webbrowser
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from rvsg.core.errors import FileError, InputError, how_to_install

if TYPE_CHECKING:
    from fastapi import FastAPI

    from rvsg_studio.workspace import Workspace

HOST = "127.0.0.1"
PORT = 8420
"""The port that is tried first where none is asked for."""
RECONNECT_S = 60.0


def serve(folder: Path, *, port: int | None, browser: bool, say: Callable[[str], None]) -> None:
    """Serve the studio of a folder until it is interrupted.

    Args:
        port: the port; 0 is any free one, None the usual one or, where that is taken, any free one.
        browser: whether to open the address in the browser of this machine.

    Raises:
        InputError: NiceGUI is not installed, or the port is taken.
        FileError: the folder is missing or cannot be written.
    """
    if not folder.is_dir():
        raise FileError(folder, "this is no folder. Name an existing one: rvsg studio DIR")
    os.chdir(folder)  # relative paths of settings and command lines are read from the folder of the studio
    folder = Path.cwd()
    with _listening(port) as sock:
        number = sock.getsockname()[1]
        token = secrets.token_urlsafe(24)
        app = make_app(folder, token=token, port=number)
        address = f"http://{HOST}:{number}/?token={token}"
        say(f"Studio of {folder}: {address}")
        say("Whoever knows this address can use the studio. Ctrl-C ends it; jobs go on.")
        if browser:
            webbrowser.open(address)
        _run(app, sock)


def make_app(folder: Path, *, token: str, port: int) -> Callable[..., object]:
    """Return the application of a studio, with its guard in front of everything."""
    own = folder.resolve() / ".rvsg-studio"
    os.environ["NICEGUI_STORAGE_PATH"] = str(own / "nicegui")  # read when NiceGUI is imported
    try:
        import nicegui  # noqa: F401
    except ImportError:
        raise InputError(f"The studio needs NiceGUI: {how_to_install('studio')}") from None
    from rvsg_studio.guard import Guard
    from rvsg_studio.workspace import Workspace

    try:
        workspace = Workspace(folder)
    except OSError as error:
        raise FileError(folder, f"the studio cannot write here: {error.strerror}. Choose another folder.") from None
    threading.Thread(target=workspace.listing, daemon=True).start()  # so that the first page waits less
    return Guard(_inner(workspace), token=token, port=port)


def _inner(workspace: Workspace) -> FastAPI:
    from fastapi import FastAPI
    from nicegui import ui

    from rvsg_studio.data import add_data
    from rvsg_studio.pages import add_pages

    app = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
    add_data(app, workspace)
    add_pages(workspace)
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
    return app


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


def _run(app: Callable[..., object], sock: socket.socket) -> None:
    import uvicorn

    logging.getLogger("uvicorn.error").setLevel(logging.WARNING)
    config = uvicorn.Config(app, log_level="warning", access_log=False, ws="auto", timeout_graceful_shutdown=2)
    uvicorn.Server(config).run(sockets=[sock])
