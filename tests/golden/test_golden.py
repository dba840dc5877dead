"""Recorded results stay bit-identical: 30 runs here, all runs and campaigns in the slow tier."""

from __future__ import annotations

import pytest
from tests.golden.cases import CAMPAIGNS, campaign_hash, run_cases, run_hash, stored

SAMPLE = run_cases()[::7][:30]


@pytest.mark.parametrize(
    "case", [pytest.param(case, marks=() if case in SAMPLE else pytest.mark.slow) for case in run_cases()]
)
def test_a_run_is_bit_identical(case: str) -> None:
    assert run_hash(case) == stored("runs")[case]


@pytest.mark.slow
@pytest.mark.parametrize("name", CAMPAIGNS)
def test_the_records_of_a_campaign_are_bit_identical(name: str) -> None:
    assert campaign_hash(name) == stored("campaigns")[name]
