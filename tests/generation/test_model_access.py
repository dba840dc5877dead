"""Faults of a service, each from a real HTTP server."""

from __future__ import annotations

import json
import threading
import time
import traceback
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from tests.coded import coded
from tests.generation.loopback import (
    Behaviour,
    completion,
    drops_in_mid_reply,
    echoes_headers_then_fails,
    fails,
    raw,
    says,
    serving,
    sleeps,
)

from rvsg.core.errors import BudgetSpent, InputError, ModelUnavailable
from rvsg.generation.vlm.access import CallNews, ModelAccess
from rvsg.generation.vlm.call_log import CallLog
from rvsg.generation.vlm.client import Fault, ModelClient, _said
from rvsg.generation.vlm.model import Access, Answer, Message, Picture, Request, Scripted, Usage

KEY = "sk-very-secret-key-0123456789"
DOT = bytes.fromhex(
    "89504e470d0a1a0a0000000d4948445200000001000000010802000000907753de"
    "0000000c49444154789c63f8ffff3f0005fe02fe0def46b80000000049454e44ae426082"
)


@pytest.fixture(autouse=True)
def _key_in_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RVSG_API_KEY", KEY)


def request(number: int = 1, *, shape: dict[str, Any] | None = None, picture: bool = False) -> Request:
    shown = Picture(name="map", png=DOT)
    message = Message(role="user", text="Say something.", pictures=(shown.reference,) if picture else ())
    return Request(
        session="s000-c00", number=number, purpose="P1", messages=(Message(role="system", text="Be brief."), message),
        pictures={shown.digest: shown} if picture else {}, shape=shape,
    )  # fmt: skip


def access(url: str, *, tries: int = 3, timeout_s: float = 5.0, **more: Any) -> tuple[ModelClient, list[float]]:
    waits: list[float] = []
    options = Access(base_url=url, call_timeout_s=timeout_s, tries=tries, longest_wait_s=30.0, **more)
    return ModelClient("openai-chat:vision-1", options, sleep=waits.append), waits


def failing(*script: Behaviour, tries: int = 3, timeout_s: float = 5.0) -> tuple[ModelUnavailable, list[float], int]:
    """The error, the waits and the number of requests of an ask that must fail; no key anywhere."""
    with serving(*script) as server:
        model, waits = access(server.url, tries=tries, timeout_s=timeout_s)
        with pytest.raises(ModelUnavailable) as caught:
            model.ask(request())
        seen = "".join(traceback.format_exception(caught.value)) + repr(caught.value.__context__)
        assert KEY not in seen
        assert caught.value.__context__ is None
        return caught.value, waits, len(server.requests)


def test_an_answer_carries_text_usage_and_cached_tokens() -> None:
    with serving(says("hello")) as server:
        answer = access(server.url, prices=(2.0, 0.5, 8.0))[0].ask(request(picture=True))
        sent = server.requests[0]["messages"]
    usage = answer.usage
    assert (answer.text, answer.finish, usage.estimated) == ("hello", "complete", False)
    assert (usage.input_tokens, usage.cached_tokens, usage.output_tokens) == (1200, 1000, 34)
    assert usage.cost_usd == pytest.approx((200 * 2.0 + 1000 * 0.5 + 34 * 8.0) / 1e6)
    assert sent[0] == {"role": "system", "content": "Be brief."}
    (url,) = [part["image_url"]["url"] for part in sent[1]["content"] if part["type"] == "image_url"]
    assert url.startswith("data:image/png;base64,")


def test_a_listed_price_counts_what_the_cache_served_at_its_own_price() -> None:
    costs = [
        ModelClient("openai-chat:gpt-4.1")._cost(Usage(input_tokens=1200, cached_tokens=cached, output_tokens=34))
        for cached in (0, 1000)
    ]
    assert costs == pytest.approx([(1200 * 2.0 + 34 * 8.0) / 1e6, (200 * 2.0 + 1000 * 0.5 + 34 * 8.0) / 1e6])


def test_tokens_are_estimated_and_marked_where_the_service_does_not_count() -> None:
    reply = completion("hello")
    del reply["usage"]
    with serving(raw(json.dumps(reply).encode())) as server:
        usage = access(server.url)[0].ask(request(picture=True)).usage
    assert usage.estimated
    assert usage.input_tokens > 85
    assert usage.cost_usd is None
    assert ModelClient("openai-chat:gpt-4.1").knows_price() and not ModelClient("openai-chat:vision-1").knows_price()


def test_waits_double_until_the_tries_are_spent() -> None:
    told, waits, asked = failing(fails(429, "slow down"))
    assert (told.code, waits, asked) == ("model-busy", [2.0, 4.0], 3)
    with serving(says("x")) as server:
        url = server.url
    for tries in (1, 2):  # the server is not there any more
        model, waits = access(url, tries=tries)
        with pytest.raises(ModelUnavailable, check=coded("model-unreachable")):
            model.ask(request())
        assert len(waits) == tries - 1


def test_a_refusal_an_empty_a_truncated_and_a_long_reply_are_answers() -> None:
    refusal, truncated = says(None, refusal="I cannot help with that."), says('{"humans": [', finish_reason="length")
    with serving(refusal, says(""), truncated, says("x" * 200_000)) as server:
        model, _ = access(server.url)
        answers = [model.ask(request(n)) for n in (1, 2, 3, 4)]
    assert [a.finish for a in answers] == ["refused", "empty", "truncated", "complete"]
    assert "cannot help" in answers[0].text and len(answers[3].text) == 200_000


def test_threads_ask_side_by_side_on_connections_of_their_own() -> None:
    with serving(says("ok")) as server, ThreadPoolExecutor(3) as pool:
        answers = list(pool.map(access(server.url)[0].ask, [request(n) for n in range(1, 7)]))
    assert [answer.text for answer in answers] == ["ok"] * 6


@pytest.mark.parametrize(
    ("name", "code"), [("openai-chat:gpt-4.1", "model-key-missing"), ("nobody:x", "model-provider")]
)
def test_a_missing_key_or_provider_is_an_input_error(name: str, code: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("OPENAI_API_KEY", raising=False)
    with pytest.raises(InputError, check=coded(code)):
        ModelClient(name).ask(request())


@pytest.mark.parametrize(
    ("fault", "waited"),
    [
        (fails(429, "slow down", {"Retry-After": "7"}), [7.0]),
        (fails(500, "oops"), [2.0]),
        (sleeps(1.5), [2.0]),
        (drops_in_mid_reply, [2.0]),
    ],
)
def test_a_passing_fault_is_tried_again_after_the_wait_that_is_asked_for(fault: Behaviour, waited: list[float]) -> None:
    with serving(fault, says("recovered")) as server:
        model, waits = access(server.url, timeout_s=0.3)
        answer = model.ask(request())
    assert (answer.text, answer.usage.tries, waits) == ("recovered", 2, waited)


def test_a_server_without_structured_output_is_asked_again_in_plain_words() -> None:
    shape = {"type": "object", "properties": {"a": {"type": "string"}}, "required": ["a"]}
    with serving(fails(400, "response_format is not supported"), says('{"a": "b"}')) as server:
        model, waits = access(server.url)
        assert model.ask(request(shape=shape)).text == '{"a": "b"}'
        assert model.ask(request(2, shape=shape)).finish == "complete"
        formats = ["response_format" in sent for sent in server.requests]
    assert formats == [True, False, False]
    assert waits == []


def test_nothing_recorded_is_lost_and_no_key_is_kept_when_the_service_fails_later(tmp_path: Path) -> None:
    with serving(says(f"my key is {KEY}"), echoes_headers_then_fails(500)) as server:
        model = ModelAccess(access(server.url)[0], recording=CallLog(tmp_path))
        model.ask(request(1, picture=True))
        with pytest.raises(ModelUnavailable):
            model.ask(request(2))
    kept = CallLog(tmp_path)
    assert [call.error is None for call in kept] == [True, False]
    everything = b"".join(path.read_bytes() for path in tmp_path.rglob("*") if path.is_file())
    assert KEY.encode() not in everything
    assert (tmp_path / "pictures").is_dir()


def test_a_budget_stops_before_the_call_that_would_pass_it_and_a_record_resumes_for_free(tmp_path: Path) -> None:
    with serving(says("one"), says("two")) as server:
        first = ModelAccess(access(server.url)[0], Access(budget_calls=1), CallLog(tmp_path))
        first.ask(request(1))
        with pytest.raises(BudgetSpent, check=coded("budget-calls")):
            first.ask(request(2))
        second = ModelAccess(access(server.url)[0], Access(budget_calls=2), CallLog(tmp_path))
        again = second.ask(request(1))
        assert (again.text, again.source) == ("one", "record")
        assert second.ask(request(2)).text == "two"
        assert len(server.requests) == 2


@pytest.mark.parametrize(
    ("budget", "prices"), [({"budget_tokens": 1300}, None), ({"budget_usd": 0.002}, (2.0, 0.5, 8.0))]
)
def test_budgets_of_tokens_and_dollars_stop_too(budget: dict[str, Any], prices: Any) -> None:
    with serving(says("one")) as server:
        model = ModelAccess(access(server.url, prices=prices)[0], Access(**budget))
        model.ask(request(1))
        model.ask(request(2))
        with pytest.raises(BudgetSpent, check=coded(next(iter(budget)).replace("_", "-"))):
            model.ask(request(3))


@pytest.mark.parametrize(
    ("name", "url", "code"),
    [
        ("gpt-4.1", None, "model-name"),
        ("openai-chat:x", "ftp://host", "model-address"),
        ("openai-chat:x", "http://me:secret@host/v1", "model-address-secret"),
        ("openai-chat:x", "http://host/v1?key=abc", "model-address-secret"),
        ("anthropic:x", "http://host/v1", "model-address-provider"),
        ("opnai:gpt-4.1", None, "model-provider"),
        ("anthropc:claude", "http://host/v1", "model-provider"),
        ("openai:", None, "model-name"),
        (":gpt-4.1", None, "model-name"),
        ("openai-chat: gpt-4.1", None, "model-name"),
    ],
)
def test_a_model_that_cannot_be_meant_is_refused(name: str, url: str | None, code: str) -> None:
    with pytest.raises(InputError, check=coded(code)):
        ModelClient(name, Access(base_url=url))


@pytest.mark.parametrize(
    ("behaviour", "code", "asked"),
    [
        (fails(401, "Incorrect API key provided: " + KEY), "model-key-refused", 1),
        (echoes_headers_then_fails(403), "model-key-refused", 1),
        (fails(404, "no such model", code="model_not_found"), "model-unknown", 1),
        (fails(402, "payment required"), "model-quota", 1),
        (fails(429, "You exceeded your current quota", code="insufficient_quota"), "model-quota", 1),
        (fails(429, "slow down"), "model-busy", 2),
        (fails(429, "tomorrow", {"Retry-After": "3600"}), "model-busy", 1),
        (fails(500, "oops"), "model-failed", 2),
        (fails(413, "too large"), "model-too-long", 1),
        (fails(400, "no images please"), "model-rejected", 1),
        (raw(b"<html>gateway</html>"), "model-protocol", 2),
        (raw(b'{"choices": [{'), "model-protocol", 2),
        (raw(b"[]"), "model-protocol", 2),
        (raw(b'{"object": "other"}'), "model-protocol", 2),
        (raw(b""), "model-protocol", 2),
        (raw(json.dumps(completion("x") | {"choices": []}).encode()), "model-protocol", 2),
        (drops_in_mid_reply, "model-unreachable", 2),
        (sleeps(1.0), "model-timeout", 2),
    ],
)
def test_every_fault_of_a_service_has_a_code_and_hides_the_client(behaviour: Behaviour, code: str, asked: int) -> None:
    error, waits, times = failing(behaviour, tries=2, timeout_s=0.3)
    assert (error.code, times, len(waits)) == (code, asked, asked - 1)
    assert "body:" not in str(error) and "status_code" not in str(error)


@pytest.mark.parametrize(
    "behaviour",
    [
        fails(400, "The prompt triggered the content management policy", code="content_filter"),
        fails(400, "no", code=None, innererror={"code": "ResponsibleAIPolicyViolation"}),
        says(None, finish_reason="content_filter"),
        says("half an ans", finish_reason="content_filter"),
    ],
)
def test_a_safety_filter_is_a_refusal_however_it_is_told(behaviour: Behaviour) -> None:
    with serving(behaviour) as server:
        answer = access(server.url)[0].ask(request())
        assert len(server.requests) == 1
    assert answer.finish == "refused"


def test_a_refusal_as_an_error_does_not_spend_a_budget_of_dollars(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(self: ModelClient, asked: Request) -> Answer:
        raise Fault("a safety filter refused it.", then="refused")

    monkeypatch.setattr(ModelClient, "_try", refuse)
    budgeted = ModelAccess(ModelClient("openai-chat:gpt-4.1"), Access(budget_usd=1.0))
    for number in (1, 2):
        assert budgeted.ask(request(number)).finish == "refused"
    assert 0.0 < budgeted.spent.cost_usd < 0.01


def test_a_wait_before_another_try_is_told_without_a_key() -> None:
    with serving(echoes_headers_then_fails(500), says("ok")) as server:
        model, _ = access(server.url)
        told: list[str] = []
        model.waiting = told.append
        model.ask(request())
    (wait,) = told
    assert "Waits 2 s, then try 2 of 3" in wait and KEY not in wait


def test_a_recorded_answer_of_another_model_is_not_taken_for_this_ones(tmp_path: Path) -> None:
    answers = [
        ModelAccess(Scripted([text], name=name), recording=CallLog(tmp_path)).ask(request()).text
        for text, name in (("one", "a"), ("two", "a"), ("three", "b"))
    ]
    assert answers == ["one", "one", "three"]


def test_calls_are_told_while_they_are_made_with_what_was_spent(tmp_path: Path) -> None:
    told: list[CallNews] = []
    for _ in range(2):
        watched = ModelAccess(Scripted(["one"]), recording=CallLog(tmp_path))
        watched.tell = told.append
        watched.ask(request())
    assert [(n.what, n.from_record, n.spent.calls) for n in told] == [
        ("asked", False, 0),
        ("answered", False, 1),
        ("asked", False, 0),
        ("answered", True, 0),
    ]


def test_calls_are_paced_apart_and_only_so_many_at_once() -> None:
    now = [0.0]
    waited: list[float] = []

    def sleep(seconds: float) -> None:
        waited.append(seconds)
        now[0] += seconds

    paced = ModelAccess(Scripted(["a", "b", "c"]), Access(calls_per_minute=30), clock=lambda: now[0], sleep=sleep)
    for number in (1, 2, 3):
        paced.ask(request(number))
    assert waited == [2.0, 2.0]

    most, inside, lock = [0], [0], threading.Lock()

    def slow(_: Request) -> str:
        with lock:
            inside[0] += 1
            most[0] = max(most[0], inside[0])
        time.sleep(0.02)
        with lock:
            inside[0] -= 1
        return "x"

    crowded = ModelAccess(Scripted([slow] * 8), Access(at_once=2))
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(crowded.ask, [request(n) for n in range(1, 9)]))
    assert most[0] == 2


def test_a_key_is_hidden_where_a_long_reply_is_cut(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LAB_API_KEY", "abcdefghijQRSTUVWXYZ0123456789")
    assert "abcdefghij" not in _said(ValueError("." * 580 + " abcdefghijQRSTUVWXYZ0123456789"))
