"""The types of the public names."""

from types import ModuleType
from typing import Any

from rvsg.api.campaign import Campaign as Campaign
from rvsg.api.evaluating import Judgement as Judgement
from rvsg.api.evaluating import evaluate as evaluate
from rvsg.api.evaluating import judge as judge
from rvsg.api.proposing import propose as propose
from rvsg.api.requirements import load_requirement as load_requirement
from rvsg.api.scenarios import check as check
from rvsg.api.scenarios import load_scenario as load_scenario
from rvsg.api.scenarios import scenario as scenario
from rvsg.api.scenarios import walk as walk
from rvsg.api.shrinking import shrink as shrink
from rvsg.api.simulating import RunSet as RunSet
from rvsg.api.simulating import load_runs as load_runs
from rvsg.api.simulating import simulate as simulate
from rvsg.api.suites import Suite as Suite
from rvsg.api.worlds import load_world as load_world
from rvsg.core.errors import InvalidScenario as InvalidScenario
from rvsg.core.errors import RvsgError as RvsgError
from rvsg.core.plugins import Spec as Spec
from rvsg.scenario.requirement import Requirement as Requirement
from rvsg.scenario.scenario import Scenario as Scenario
from rvsg.simulation.run import Run as Run
from rvsg.world.world import World as World

__version__: str

class CallableModule(ModuleType):
    def __call__(self, *args: Any, **options: Any) -> Any: ...
