"""The types of the public names."""

from types import ModuleType
from typing import Any

from rvsg.app.campaign import Campaign as Campaign
from rvsg.app.proposal import propose as propose
from rvsg.app.suites import Suite as Suite
from rvsg.core.errors import InvalidScenario as InvalidScenario
from rvsg.core.errors import RvsgError as RvsgError
from rvsg.core.plugins import Spec as Spec
from rvsg.evaluation.verdict import load_requirement as load_requirement
from rvsg.recording.intent import recorded_scenario as recorded_scenario
from rvsg.recording.tracks import load_recording as load_recording
from rvsg.scenario.builder import check as check
from rvsg.scenario.builder import load_scenario as load_scenario
from rvsg.scenario.builder import scenario as scenario
from rvsg.scenario.builder import walk as walk
from rvsg.scenario.requirement import Requirement as Requirement
from rvsg.scenario.scenario import Scenario as Scenario
from rvsg.scenario.world_lookup import load_world as load_world
from rvsg.search.run_set import Judgement as Judgement
from rvsg.search.run_set import RunSet as RunSet
from rvsg.search.run_set import evaluate as evaluate
from rvsg.search.run_set import judge as judge
from rvsg.search.run_set import load_runs as load_runs
from rvsg.search.run_set import simulate as simulate
from rvsg.search.smallest_scenario import shrink as shrink
from rvsg.simulation.run import Run as Run
from rvsg.world.world import World as World

__version__: str

class CallableModule(ModuleType):
    def __call__(self, *args: Any, **options: Any) -> Any: ...
