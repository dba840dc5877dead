"""Make the example suite anew, or confirm it again.

    python examples/warehouse_suite.py find       # search, confirm, and write examples/suites/warehouse
    python examples/warehouse_suite.py confirm    # run the suite, and write the verdicts into the reasons

A case is a confirmed violation of a requirement that the people cause: without them the requirement holds. `find` takes
about ten minutes on two cores. `confirm` ends with exit code 1 where a case is no violation any more.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from rvsg import Campaign, Suite
from rvsg.suites.suite import CaseResult, State

SUITE = Path(__file__).parent / "suites" / "warehouse"
PAIRS = [
    ("route_1", "R1"),
    ("route_1", "R2"),
    ("route_1", "clearance"),
    ("route_2", "R1"),
    ("route_2", "R3"),
    ("route_2", "clearance"),
    ("route_3", "R1"),
    ("route_3", "clearance"),
    ("route_4", "R2"),
    ("route_4", "clearance"),
    ("route_5", "R1"),
    ("route_5", "clearance"),
]
BUDGETS = (
    {"scenarios": 6, "refinements": 1, "repeats": 3, "confirmations": 20},
    {"scenarios": 25, "refinements": 4, "repeats": 5, "confirmations": 60},
)
"""The second one is for pairs in which the first finds nothing."""


def find(folder: Path, runs: Path) -> Suite:
    """Run a short campaign for each pair of route and requirement, and keep its worst finding about people."""
    suite = Suite.create(folder, title="Twelve confirmed failures in the warehouse")
    for route, requirement in PAIRS:
        for budget in BUDGETS:
            out = runs / f"{route}-{requirement}-{budget['scenarios']}"
            campaign = Campaign.create(out, world="warehouse", route=route, requirement=requirement, **budget)
            for _ in campaign.run():
                pass
            found = next((each for each in campaign.findings if each.violated and each.about_people == "yes"), None)
            if found is not None:
                break
        else:
            print(f"{route}, {requirement}: no finding about people")
            continue
        attempt = next(each for each in campaign.attempts() if each.index == found.confirmation)
        assert attempt.proposal.scenario is not None
        scenario = attempt.proposal.scenario
        work = scenario.description.removeprefix("The work of the hour: ").split(".")[0]
        title = f"{route}: {work}"
        name = f"{route}-{requirement}".lower()
        suite = suite.add(scenario, requirement, name=name, title=title, reason="found by a search")
    return suite


def confirm(suite: Suite, *, jobs: int = 2) -> list[CaseResult]:
    """Run the suite, write what it says into the reasons, and return the cases that are no violation any more."""
    result = suite.run(jobs=jobs, on_result=lambda case: print(f"{case.state.value:14} {case.case}"))
    for case in result.cases:
        if case.state is State.KNOWN_FAILURE:
            scenario = next(each.scenario for each in suite.cases if each.name == case.case)
            reason = f"{case.verdict.violations} of {case.verdict.runs} runs violate it"
            suite = suite.add(scenario, case.requirement, reason=reason)
    return [case for case in result.cases if case.state is not State.KNOWN_FAILURE]


def main() -> int:
    """Do what the first argument says."""
    wanted = sys.argv[1:] or ["confirm"]
    if wanted == ["find"]:
        with tempfile.TemporaryDirectory() as runs:
            find(SUITE, Path(runs))
    elif wanted != ["confirm"]:
        print(__doc__)
        return 2
    return 1 if confirm(Suite.open(SUITE)) else 0


if __name__ == "__main__":
    sys.exit(main())
