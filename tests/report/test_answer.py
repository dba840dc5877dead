"""The answer of a campaign: its names, figures and headline."""

from __future__ import annotations

import pytest
from tests.campaign.parts import MemoryLedger, warehouse
from tests.report.test_page import _with_objectives, answer, campaign, default_campaign, result_of

from rvsg.evaluation.detection import contacts
from rvsg.evaluation.sampled import sampled
from rvsg.report.result import _headline
from rvsg.runs.attempt import Attempt
from rvsg.runs.observation import INTO
from rvsg.runs.runner import Evaluator
from rvsg.simulation.events import responsible_in_words


def attempts_with(objective: float) -> list[Attempt]:
    """The campaign with confirmation runs of this value."""
    made = default_campaign()[1]
    return [_with_objectives(a, objective) if a.purpose == "confirmation" else a for a in made]


@pytest.mark.parametrize(("objective", "said"), [(0.5, "mean 0.5 m"), (2.0, "mean 2 m")])
def test_a_measured_mean_is_named_as_such_beside_the_limit_of_each_run(objective: float, said: str) -> None:
    the_plan, _, ledger = default_campaign()
    measured = answer(the_plan, attempts_with(objective), ledger).figures[1]
    assert (measured.value, measured.note) == (said, "limit: at least 1 m in each run")


def test_a_failure_with_contact_is_named_by_who_is_responsible() -> None:
    ledger = MemoryLedger()
    the_plan, attempts = campaign(ledger, confirmations=15)
    judge = Evaluator(the_plan.requirement, warehouse())
    measured = [
        a.replace(measurements=tuple(judge.measure(ledger.run(m.run_id)) for m in a.measurements)) for a in attempts
    ]
    touched = [row for row in answer(the_plan, measured, ledger).rows if row.contacts]
    assert touched
    for row in touched:
        first = next(iter(contacts(sampled(ledger.run(row.run), warehouse()))))
        assert INTO[first.responsible] in row.name and first.person == row.who
        assert first.responsible is not None and responsible_in_words(first.responsible) in row.touch


def test_the_headline_of_a_rarer_failure_tells_the_one_that_makes_its_status() -> None:
    the_plan, _, ledger = default_campaign()
    attempts = attempts_with(0.5)
    row = answer(the_plan, attempts, ledger).rows[0]
    always, rare = row.replace(often="always"), row.replace(number="9.9", often="sometimes")
    result, verdict = result_of(the_plan, attempts, ledger), attempts[-1].verdict
    said = _headline(result, [rare, always], verdict, None)
    assert said.endswith(f" Always violated: {always.number}, {always.share}.")
    assert "Always" not in _headline(result, [always, rare], verdict, None)
