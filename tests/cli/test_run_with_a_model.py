"""Whole campaigns against a real HTTP server: they go on, or stop with a clear message, and lose nothing."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from tests.cli.commands import Terminal
from tests.generation.loopback import Behaviour, LoopbackServer, drops_in_mid_reply, fails, raw, says, serving

KEY = "sk-campaign-secret-key-42424242"


def person(name: str, there: tuple[str, ...], between: tuple[str, str]) -> dict[str, Any]:
    ways = ((between, there), (between[::-1], there[::-1]))
    tasks = [
        {"task": f"{a} → {b}", "path": list(path), "pauses": [{"at": path[-1], "duration_s": 5, "doing": "pick"}]}
        for (a, b), path in ways
    ]
    return {"name": name, "tasks": tasks}


PEOPLE = [
    person("Human 1", ("G10", "G11"), ("Area 2", "Area 3")),
    person("Human 2", ("D22", "E21", "D20"), ("Shelf 6", "Shelf 5")),
]
GOOD = json.dumps({"analysis": "They meet.", "description": "Restocking.", "humans": PEOPLE})


@pytest.fixture(autouse=True)
def _environment(terminal: Terminal, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RVSG_API_KEY", KEY)
    monkeypatch.setenv("RVSG_DATA_DIR", "data")


def of(server: LoopbackServer) -> str:
    return f"--model openai-chat:vision-1 --base-url {server.url}"


COUNTS = "--refinements 0 --repeats 1 --confirmations 0 --jobs 1 --simulator kinematic"
OPTIONS = "--out c --generator-option tries=2 --generator-option call_timeout_s=5"
RUN = f"run {COUNTS} {OPTIONS} --scenarios 2"
ONE = f"run {COUNTS} {OPTIONS} --scenarios 1"
SOON = "--generator-option first_wait_s=0.01"


def nothing_leaks(*texts: str) -> None:
    for text in texts:
        assert KEY not in text
    for path in Path("c").rglob("*"):
        assert not path.is_file() or KEY.encode() not in path.read_bytes(), path


def test_refusals_and_rubbish_become_attempts_with_problems_and_the_campaign_goes_on(terminal: Terminal) -> None:
    refuses: Behaviour = says(None, refusal=f"I cannot, and {KEY} is my key.")  # type: ignore[arg-type]
    with serving(refuses, says(""), says("x" * 200_000), says(GOOD)) as server:
        result = terminal.json(RUN, of(server))
    assert result["accounting"]["calls"] == 4
    assert len(result["ranking"]) == 1
    nothing_leaks(terminal.out, terminal.err)
    assert result["accounting"]["invalid_proposals"] == 1
    assert "1 was refused (by the model or a safety filter): try another model" in terminal.err
    assert "1 was empty" in terminal.err


def test_a_service_that_drops_and_stumbles_is_asked_again(terminal: Terminal) -> None:
    with serving(drops_in_mid_reply, says(GOOD)) as server:
        nothing_leaks(terminal(ONE, of(server), SOON))


@pytest.mark.parametrize(
    ("behaviour", "code"),
    [
        (fails(401, f"bad key {KEY}"), "model-key-refused"),
        pytest.param(fails(404, "no such model"), "model-unknown", marks=pytest.mark.exhaustive),
        pytest.param(fails(429, "later", {"Retry-After": "9999"}), "model-busy", marks=pytest.mark.exhaustive),
        pytest.param(raw(b"<html>"), "model-protocol", marks=pytest.mark.exhaustive),
        (fails(500, f"broken, {KEY}"), "model-failed"),
    ],
)
def test_a_service_that_cannot_answer_stops_the_campaign_with_one_message_and_it_resumes(
    terminal: Terminal, behaviour: Behaviour, code: str
) -> None:
    with serving(says(GOOD), behaviour) as server:
        assert terminal.refused(RUN, of(server), SOON).code == code
        nothing_leaks(terminal.err)
        asked = len(server.requests)
        server.script[:] = [says(GOOD)]
        terminal("run --out c --jobs 1")
        assert len(server.requests) == asked + 1


def test_a_spent_budget_ends_with_code_3_and_a_larger_one_goes_on(terminal: Terminal) -> None:
    with serving(says(GOOD)) as server:
        told = terminal(RUN, of(server), "--budget-calls 1", code=3)
        assert "1 of 1 calls" in told and "Resume with: rvsg run --out c --jobs 1 --budget-...\n" in told
        terminal("run --out c --budget-calls 5 --jobs 1")
        terminal("run", COUNTS, "--scenarios 2 --replay c/vlm --out again")
        assert len(server.requests) == 2


def test_a_wrong_model_is_mended_in_the_same_folder_while_nothing_is_kept(terminal: Terminal) -> None:
    with serving(fails(404, "no such model"), says(GOOD)) as server:
        assert '"vision-1"' in terminal(ONE, of(server), code=2)
        terminal(ONE, of(server).replace("vision-1", "vision-2"))
        assert terminal.refused(ONE, of(server).replace("vision-1", "vision-3")).code == "other-settings"


@pytest.mark.parametrize("verb", ["run", "scenario propose", "world describe warehouse"])
@pytest.mark.parametrize("option", ["--budget-usd", "--budget-calls", "--budget-tokens"])
def test_a_budget_of_nothing_is_refused_before_anything_is_asked(terminal: Terminal, verb: str, option: str) -> None:
    with serving(says(GOOD)) as server:
        assert terminal.refused(verb, of(server), option, "0").code in ("input", "options")
        assert server.requests == []


DESCRIBE = "world describe warehouse --out d.yaml"


def test_a_description_that_fails_half_way_keeps_what_was_paid_for_and_goes_on_from_it(terminal: Terminal) -> None:
    texts = json.dumps({"layout": "Shelves above.", "grid": "Row E."})
    with serving(says("the layout"), says("the grid"), fails(401, f"bad key {KEY}"), says(texts)) as server:
        stopped = terminal(DESCRIBE, of(server), code=2)
        assert "layout: answered after" in stopped
        told = terminal(DESCRIBE, of(server))
        assert "2 calls were answered at no cost from runs/describe-warehouse" in told
        assert len(server.requests) == 4
    assert "Shelves above." in Path("d.yaml").read_text()
    for text in (stopped, told, *(p.read_text() for p in Path().rglob("*") if p.suffix in (".jsonl", ".yaml"))):
        assert KEY not in text


@pytest.mark.parametrize(
    ("behaviour", "told"),
    [
        (says(None, refusal="I cannot."), "refused to look at the map. I cannot."),  # type: ignore[arg-type]
        (says(""), "answered nothing"),
        (says("no JSON"), "it held no such JSON"),
        (says('{"layout": "x', finish_reason="length"), "cut off by the limit of tokens"),
    ],
)
def test_an_answer_that_describes_nothing_is_told_and_kept(terminal: Terminal, behaviour: Behaviour, told: str) -> None:
    with serving(says("the layout"), behaviour) as server:
        said = terminal(DESCRIBE, of(server), code=2)
    assert told in said
    assert "The answers so far are in runs/describe-warehouse." in said
    assert not Path("d.yaml").exists()


def test_a_proposal_says_what_it_spends_and_that_nothing_came_of_it(terminal: Terminal) -> None:
    options = "--generator-option prices=2.0,0.5,8.0 --generator-option corrections=1 --budget-calls 2"
    with serving(says('{"humans": [', finish_reason="length")) as server:
        said = terminal("scenario propose", of(server), options)
    assert "Asking openai-chat:vision-1: new" in said
    assert "correct: answered after 0 s; 0.0023 USD so far" in said
    assert "2 were cut off by the limit of tokens: raise max_output_tokens" in said
    assert json.loads(terminal.out)["scenario"] is None


def test_progress_shows_the_call_under_way_why_it_waits_and_what_was_spent(terminal: Terminal) -> None:
    with serving(fails(500, "busy"), says(GOOD)) as server:
        told = terminal(ONE, of(server), SOON, "--generator-option prices=2,0.5,8")
    assert "new: the service failed. It said: HTTP 500, busy. Waits 0 s, then try 2 of 2." in told
    assert "model 0.0012 USD" in told


def test_a_budget_is_for_all_the_campaigns_of_a_command_together(terminal: Terminal) -> None:
    two = "--route route_1 --route route_3 --budget-calls 1 --model openai-chat:vision-1"
    assert terminal.refused(RUN, two, "--base-url http://127.0.0.1:9/v1").code == "budget-too-small"
