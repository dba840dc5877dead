"""What attempts take in memory, and that nothing they say changes by it."""

from __future__ import annotations

import math
import pickle

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError
from tests.campaign.parts import WalkGenerator, plan, warehouse

from rvsg.campaign.attempt import Attempt, Measurement, Values
from rvsg.campaign.ledger import Sharing
from rvsg.core.records import canonical_json
from rvsg.scenario.brief import Brief, Remembered

metrics = st.dictionaries(st.text(max_size=5), st.none() | st.floats(allow_nan=False, allow_infinity=False))


@given(metrics)
def test_values_are_a_mapping_that_survives_records_and_pickles(given_values: dict[str, float | None]) -> None:
    measured = Measurement(run_id="run-1", seed=1, outcome="x", values=given_values)
    values = measured.values
    assert isinstance(values, Values) and values == given_values and list(values) == list(given_values)
    assert measured.model_dump(mode="json")["values"] == given_values
    again = Measurement.from_json(measured.to_json())
    assert again == measured == pickle.loads(pickle.dumps(measured))
    assert again.id == measured.id == measured.replace(values=dict(values)).id


@pytest.mark.parametrize("bad", [math.nan, math.inf, "much", [1.0]])
def test_a_value_that_is_no_number_is_refused(bad: object) -> None:
    with pytest.raises(ValidationError):
        Measurement(run_id="run-1", seed=1, outcome="x", values={"dto": bad})


def test_runs_share_the_names_of_metrics_and_how_they_ended() -> None:
    def received(seed: int) -> Measurement:
        given = Measurement(run_id=f"run-{seed}", seed=seed, outcome=f"the goal{' '}was reached", values={"dto": 1.0})
        return pickle.loads(pickle.dumps(given))

    first, second = received(1), received(2)
    assert next(iter(first.values)) is next(iter(second.values))
    assert first.outcome is second.outcome


def attempts() -> list[Attempt]:
    """Attempts that each remember those before, as many objects as if each were read from a file."""
    found: list[Attempt] = []
    for index in range(4):
        brief = Brief(mission=plan().mission, requirement=plan().requirement, seed=index)
        proposal = WalkGenerator().propose(brief, warehouse())
        memory = tuple(
            Remembered(
                description=a.proposal.scenario.description,
                tasks={},
                mean=1.0,
                interval=(0.0, 1.0),
                scenario=a.proposal.scenario,
            )
            for a in found
            if a.proposal.scenario is not None
        )
        attempt = Attempt(
            campaign="c", index=index, strategy="s", brief=brief.replace(memory=memory), proposal=proposal
        )
        found.append(Attempt.from_json(attempt.to_json()))
    return found


def test_attempts_share_equal_parts_and_say_the_same() -> None:
    given_attempts = attempts()
    before = [canonical_json(attempt.model_dump(mode="json")) for attempt in given_attempts]
    shared = Sharing()
    for attempt in given_attempts:
        assert shared(attempt) is attempt
    assert [canonical_json(attempt.model_dump(mode="json")) for attempt in given_attempts] == before
    first, *_, last = given_attempts
    assert last.brief.mission is first.brief.mission and last.brief.requirement is first.brief.requirement
    assert last.brief.memory[0].scenario is first.proposal.scenario
    assert last.brief.memory[0] is given_attempts[1].brief.memory[0]
    assert last.brief.memory[0].scenario.people.humans[0].tasks[0] is first.proposal.scenario.people.humans[0].tasks[0]
    assert first.replace(index=7).index == 7 and first.model_copy(update={"index": 8}).index == 8
