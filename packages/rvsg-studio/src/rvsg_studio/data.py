"""The data behind the pages: what the JavaScript components fetch and send. Every answer is JSON or a listed file."""

from __future__ import annotations

import json
from collections.abc import Callable
from importlib import resources
from typing import Any

from fastapi import FastAPI, Request
from fastapi.responses import JSONResponse, Response
from nicegui import run

from rvsg.core import permission
from rvsg.core.errors import RvsgError
from rvsg.report.page import component, look
from rvsg_studio import answers, unsaved_input
from rvsg_studio.answers import trace
from rvsg_studio.unsaved_input import typed, typed_keep
from rvsg_studio.workspace import Workspace

ASKED = {**answers.ANSWERS, "names": answers.names, "typed": typed, "files": unsaved_input.listed}
SENT = {
    **answers.CHANGES,
    "trace": trace,
    "names-ask": answers.ask,
    "names-drop": answers.drop,
    "names-model": answers.model,
    "typed-keep": typed_keep,
    "files-forget": unsaved_input.forget,
}
LARGEST = 2_000_000
"""Bytes that a request may send."""
OWN_FILES = {
    "studio.css": "text/css",
    "studio.js": "text/javascript",
    "world.js": "text/javascript",
    "pages.js": "text/javascript",
    "scenario.js": "text/javascript",
}


def add_data(app: FastAPI, workspace: Workspace) -> None:
    """Add the addresses of the files and data to the application."""

    @app.get("/files/{name}")
    def files(name: str) -> Response:
        if name == "look.css":
            return Response(look(), media_type="text/css", headers=FRESH)
        if name == "replay.js":
            return Response(component(), media_type="text/javascript", headers=FRESH)
        if name in OWN_FILES:
            text = (resources.files("rvsg_studio") / "static" / name).read_text(encoding="utf-8")
            return Response(text, media_type=OWN_FILES[name], headers=FRESH)
        return Response(status_code=404)

    for name, answer in ASKED.items():
        app.add_api_route(f"/data/{name}", _asked(workspace, answer), methods=["GET"])
    for name, answer in SENT.items():
        app.add_api_route(f"/data/{name}", _sent(workspace, answer), methods=["POST"])

    @app.post("/data/file")
    async def file(request: Request, name: str = "") -> Response:
        if request.headers.get("content-type") != "application/octet-stream":
            return JSONResponse({"error": "Expected the bytes of a file."}, status_code=415)
        content = await _limited(request, unsaved_input.LARGEST)
        if content is None:
            return JSONResponse(
                {"error": f"{name}: the file has more than {unsaved_input.LARGEST} bytes."}, status_code=413
            )
        return await _answered(workspace, lambda place, _: unsaved_input.receive(place, name, content), {})


async def _limited(request: Request, most: int) -> bytes | None:
    """Return what a request sends; None where it is more than it may be."""
    content = bytearray()
    async for piece in request.stream():
        content += piece
        if len(content) > most:
            return None
    return bytes(content)


FRESH = {"cache-control": "no-cache"}
Answer = Callable[[Workspace, dict[str, Any]], Any]


def _asked(workspace: Workspace, answer: Answer) -> Callable[[Request], Any]:
    async def asked(request: Request) -> Response:
        return await _answered(workspace, answer, dict(request.query_params))

    return asked


def _sent(workspace: Workspace, answer: Answer) -> Callable[[Request], Any]:
    async def sent(request: Request) -> Response:
        if request.headers.get("content-type", "").partition(";")[0] != "application/json":
            return JSONResponse({"error": "Expected JSON."}, status_code=415)
        content = await _limited(request, LARGEST)
        if content is None:
            return JSONResponse({"error": "The request is too large."}, status_code=413)
        try:
            value = json.loads(content)
        except ValueError:
            return JSONResponse({"error": "This is no JSON."}, status_code=400)
        if not isinstance(value, dict):
            return JSONResponse({"error": "Expected an object."}, status_code=400)
        return await _answered(workspace, answer, value)

    return sent


async def _answered(workspace: Workspace, answer: Answer, given: dict[str, Any]) -> Response:
    def work() -> Any:
        with permission.only():  # a request names no code of its own
            return answer(workspace, given)

    try:
        made = await run.io_bound(work)
    except RvsgError as error:
        return JSONResponse({"error": str(error)}, status_code=400)
    return made if isinstance(made, Response) else JSONResponse(made)
