"""The plug-in shown in the documentation passes the exam."""

import re
from pathlib import Path

from tests.campaign.parts import WalkGenerator, plan, warehouse

from rvsg.campaign.conformance import check_strategy
from rvsg.scenario.brief import Brief

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "write-a-plug-in.md"


def test_the_documented_strategy_keeps_the_promises_of_a_strategy() -> None:
    code = re.search(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL)
    assert code is not None
    names: dict[str, object] = {}
    exec(code[1], names)
    brief = Brief(mission=plan().mission, requirement=plan().requirement, seed=3)
    scenario = WalkGenerator().propose(brief, warehouse()).scenario
    assert scenario is not None
    check_strategy(names["TwiceStrategy"], plan(), scenario)  # type: ignore[arg-type]
