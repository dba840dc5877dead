"""A real HTTP server on the loopback address that speaks the OpenAI chat protocol, well or badly."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

Behaviour = Callable[["Handler", dict[str, Any]], None]


class Handler(BaseHTTPRequestHandler):
    server: LoopbackServer

    def do_POST(self) -> None:
        body = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
        with self.server.lock:
            self.server.requests.append(body)
            self.server.headers.append(dict(self.headers))
            script = self.server.script
            behaviour = script.pop(0) if len(script) > 1 else script[0]
        behaviour(self, body)

    def send(self, status: int, payload: bytes, headers: dict[str, str] | None = None) -> None:
        self.send_response(status)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(payload)))
        for name, value in (headers or {}).items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(payload)

    def log_message(self, format: str, *args: Any) -> None:
        pass


class LoopbackServer(ThreadingHTTPServer):
    daemon_threads = True

    def __init__(self, script: list[Behaviour]) -> None:
        super().__init__(("127.0.0.1", 0), Handler)
        self.script = script
        self.requests: list[dict[str, Any]] = []
        self.headers: list[dict[str, str]] = []
        self.lock = threading.Lock()

    def handle_error(self, request: Any, client_address: Any) -> None:
        pass

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.server_address[1]}/v1"


@contextmanager
def serving(*script: Behaviour) -> Iterator[LoopbackServer]:
    """Serve the behaviours one after another; the last one for ever."""
    server = LoopbackServer(list(script))
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01}, daemon=True)
    thread.start()
    try:
        yield server
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


def completion(text: str | None, **message: Any) -> dict[str, Any]:
    usage = {"prompt_tokens": 1200, "completion_tokens": 34, "total_tokens": 1234}
    return {
        "id": "chatcmpl-1",
        "object": "chat.completion",
        "created": 1,
        "model": "vision-1",
        "choices": [
            {
                "index": 0,
                "finish_reason": message.pop("finish_reason", "stop"),
                "message": {"role": "assistant", "content": text, **message},
            }
        ],
        "usage": usage | {"prompt_tokens_details": {"cached_tokens": 1000}},
    }


def says(text: str, **message: Any) -> Behaviour:
    return lambda handler, body: handler.send(200, json.dumps(completion(text, **dict(message))).encode())


def fails(status: int, message: str = "no", headers: dict[str, str] | None = None, **error: Any) -> Behaviour:
    payload = json.dumps({"error": {"message": message, "type": "error", **error}}).encode()
    return lambda handler, body: handler.send(status, payload, headers)


def raw(payload: bytes, status: int = 200) -> Behaviour:
    return lambda handler, body: handler.send(status, payload)


def echoes_headers_then_fails(status: int) -> Behaviour:
    """A careless service that repeats the caller's headers, key included, in its error."""

    def behave(handler: Handler, body: dict[str, Any]) -> None:
        told = f"refused: {dict(handler.headers)}"
        handler.send(status, json.dumps({"error": {"message": told}}).encode())

    return behave


def sleeps(seconds: float) -> Behaviour:
    def behave(handler: Handler, body: dict[str, Any]) -> None:
        time.sleep(seconds)
        handler.send(200, json.dumps(completion("late")).encode())

    return behave


def drops_in_mid_reply(handler: Handler, body: dict[str, Any]) -> None:
    payload = json.dumps(completion("this reply is never finished")).encode()
    handler.send_response(200)
    handler.send_header("Content-Type", "application/json")
    handler.send_header("Content-Length", str(len(payload)))
    handler.end_headers()
    handler.wfile.write(payload[: len(payload) // 2])
    handler.wfile.flush()
    handler.connection.close()
