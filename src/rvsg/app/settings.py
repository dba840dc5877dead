"""The settings of a campaign: the one list of them, and how a campaign file and options make a configuration.

`CampaignConfig` and its bases declare every setting once, with its type, bounds, default, help and group. The options
of the command line, the campaign file, its reference page and the studio's form are made from it (`settings`). A
configuration is made of the defaults, then the campaign file, then the command line. Paths in the file are relative to
the file.
"""

from __future__ import annotations

import re
import types
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import pydantic
import yaml
from pydantic import BeforeValidator, Field, model_validator

from rvsg.core import plugins
from rvsg.core.documents import Document, keys_of, mistakes_of, parse_yaml, read_yaml, validated
from rvsg.core.errors import InvalidOptions
from rvsg.core.plugins import Spec
from rvsg.core.records import Record
from rvsg.core.setting import MODEL, OUTPUT, RUNS, SEARCH, TEST, Setting
from rvsg.evaluation.verdict import Procedure, Rates
from rvsg.generation.vlm.model import NO_CALL
from rvsg.robots.robot import DEFAULT_ROBOT, shipped_robots
from rvsg.runs.attempt import SearchSettings
from rvsg.scenario.requirement import shipped_requirements
from rvsg.simulation.stacks.stack_choice import DEFAULT_STACK, default_stack
from rvsg.world.world import State
from rvsg.world.world_folder import as_named, shipped_worlds

NEAR = 0.5


class WhatIsTested(Record):
    """The settings that come first: world, route, requirement, robot."""

    world: Annotated[
        str,
        Setting("A shipped world or a world folder.", TEST, label="World", common=True, file="or name"),
    ] = "warehouse"
    route: Annotated[str, Setting("A route of the world.", TEST, label="Routes", common=True, several=True)] = "route_1"
    requirement: Annotated[
        str,
        Setting(
            "A shipped requirement, or FILE.yaml#NAME.",
            TEST,
            label="Requirements",
            common=True,
            several=True,
            file="or name",
        ),
    ] = "R1"
    also: Annotated[
        list[str],
        Setting(
            "A further requirement for the strategy multi.",
            TEST,
            more="Each needs a metric and a limit.",
            file="or name",
        ),
    ] = Field(default_factory=list)
    robot: Annotated[
        str,
        Setting("A shipped robot (`rvsg robots`) or a robot file.", TEST, label="Robot", common=True, file="or name"),
    ] = DEFAULT_ROBOT
    moved: Annotated[
        str | None,
        Field(min_length=1),
        Setting(
            "Objects in the robot's way that its map does not show (objects.yaml).", TEST, metavar="FILE", file="path"
        ),
    ] = None
    doors: Annotated[
        dict[str, State],
        Setting(
            "A door that is open, closed or automatic.",
            TEST,
            more="In the file: `{Ward: closed}`.",
            option="--door",
            metavar="NAME=STATE",
        ),
    ] = Field(default_factory=dict)


class CampaignConfig(Rates, SearchSettings, WhatIsTested):
    """Every setting of `rvsg run`; those of a base come first, the last base before the others.

    To add one, declare it and use it: here, or in `SearchSettings` where the plan of a campaign needs it.
    """

    knowledge: Annotated[
        str | None,
        Field(min_length=1),
        Setting(
            "Earlier scenarios that new ones must differ from (`rvsg knowledge search --out FILE`).",
            SEARCH,
            metavar="FILE",
            file="path",
        ),
    ] = None
    start_from: Annotated[
        str | None,
        Field(min_length=1, exclude_if=lambda path: path is None),
        Setting(
            "A scenario to search near, e.g. of a recording.",
            SEARCH,
            more="World, route, robot and number of people are the scenario's where left out; more people are added.",
            option="--from",
            metavar="FILE",
            file="path",
        ),
    ] = None
    near: Annotated[
        float,
        Field(gt=0, le=10, exclude_if=lambda near: near == NEAR),
        Setting("How far people may be from that scenario, metres and seconds.", SEARCH, more="And a fifth in m/s."),
    ] = NEAR
    generator: Annotated[
        str | None,
        Setting(
            "Writes the scenarios: heuristic, random, vlm, or a plug-in.",
            SEARCH,
            more="Without it: `random` for the strategy `random`, `vlm` where `model` or `replay` is given.",
            default="heuristic",
            label="Who writes the scenarios",
            common=True,
        ),
    ] = None
    generator_options: Annotated[dict[str, Any], Setting("An option of the generator.", SEARCH)] = Field(
        default_factory=dict
    )
    strategy: Annotated[
        str,
        Setting(
            "What to try next: study, hybrid, multi, unguided, random, or a plug-in.",
            SEARCH,
            more="`study` refines a scenario from what it measured, then writes one that differs; `hybrid` drafts with "
            "the generator and tunes in the simulator; `multi` weighs several requirements; "
            "`unguided` tells the generator no requirement, feedback or memory. "
            "Without it, a vision language model works with `study`.",
            label="Strategy of the search",
            common=True,
        ),
    ] = "hybrid"
    simulator: Annotated[
        str,
        Setting(
            "embedded; kinematic: no physics; ros2-world: your own; or a plug-in.",
            RUNS,
            more="Verdicts of `kinematic` say nothing of a robot.",
        ),
    ] = "embedded"
    simulator_options: Annotated[
        dict[str, Any], Setting("An option of the simulator.", RUNS, more="For example `profile: published-study`.")
    ] = Field(default_factory=dict)
    stack: Annotated[
        str | None,
        Setting(
            "Navigation stack under test: a name (`rvsg stacks`) or a file.",
            TEST,
            label="Stack",
            more="Or a command; see [Test your own stack](../how-to/test-your-own-stack.md).",
            default=f"{DEFAULT_STACK}, or that of the profile",
            common=True,
            file="or name",
        ),
    ] = None
    stack_options: Annotated[dict[str, Any], Setting("An option of the stack.", TEST)] = Field(default_factory=dict)
    shrink_runs: Annotated[
        int,
        Field(ge=0, le=1_000_000),
        Setting("Runs that shrink the distinct failures; 0: do not.", SEARCH, decides=False),
    ] = 200
    search_anyway: Annotated[
        bool, Setting("Search even where the robot never arrives without people.", SEARCH, decides=False)
    ] = False
    jobs: Annotated[
        int | None,
        Field(ge=1, le=1024),
        Setting("Worker processes.", RUNS, default="one per core", decides=False, machine=True),
    ] = None
    executor: Annotated[
        str,
        Setting(
            "Makes the runs: processes (see --jobs), cluster, or a plug-in.",
            RUNS,
            more="`cluster` is a [Dask cluster](../how-to/use-a-cluster.md).",
            decides=False,
            machine=True,
        ),
    ] = "processes"
    executor_options: Annotated[
        dict[str, Any],
        Setting(
            "An option of the executor.",
            RUNS,
            more="For example `address: tcp://10.0.0.1:8786`.",
            decides=False,
            machine=True,
        ),
    ] = Field(default_factory=dict)
    store: Annotated[
        str,
        Setting(
            "Store of the campaign: sqlite, or a plug-in.", OUTPUT, more="A folder keeps its store.", decides=False
        ),
    ] = "sqlite"
    store_options: Annotated[dict[str, Any], Setting("An option of the store.", OUTPUT, decides=False)] = Field(
        default_factory=dict
    )
    out: Annotated[
        str | None,
        Field(min_length=1),
        Setting(
            "Folder of the campaign; an existing one is resumed.",
            OUTPUT,
            default="runs/, named for the settings",
            label="Folder",
            common=True,
            file="path",
            decides=False,
        ),
    ] = None
    fail_on_violation: Annotated[
        bool, Setting("Exit with code 1 if the requirement is violated.", OUTPUT, decides=False)
    ] = False
    junit: Annotated[
        str | None,
        Setting("Write the verdicts as JUnit XML.", OUTPUT, metavar="FILE", file="path", decides=False),
    ] = None
    model: Annotated[
        str | None,
        Setting(
            "The model, PROVIDER:NAME, e.g. openai-chat:gpt-4.1.",
            MODEL,
            more="Its key comes from the environment only.",
            label="Model",
            common=True,
            of_model=True,
        ),
    ] = None
    base_url: Annotated[
        str | None,
        Setting("Address of an OpenAI-compatible server (key: RVSG_API_KEY).", MODEL, of_model=True),
    ] = None
    conversation: Annotated[
        Literal["compact", "study"], Setting("Form of the conversation: compact or study.", MODEL, of_model=True)
    ] = "compact"
    prompts: Annotated[
        str | None,
        Setting("Folder of prompt templates that replace the shipped ones.", MODEL, file="path", of_model=True),
    ] = None
    replay: Annotated[
        str | None,
        Setting("Answer from the calls recorded in this folder, without a model.", MODEL, file="path", of_model=True),
    ] = None
    budget_usd: Annotated[
        float | None,
        Field(gt=0),
        Setting(
            "Stop before the calls of a model cost more.", MODEL, label="Budget in USD", decides=False, of_model=True
        ),
    ] = None
    budget_calls: Annotated[
        int | None, Field(ge=1), Setting("Stop before more calls of a model.", MODEL, decides=False, of_model=True)
    ] = None
    budget_tokens: Annotated[
        int | None, Field(ge=1), Setting("Stop before more tokens of a model.", MODEL, decides=False, of_model=True)
    ] = None

    @model_validator(mode="before")
    @classmethod
    def _usual_strategy(cls, values: Any) -> Any:
        """Where a model writes, or a scenario is searched near, a strategy that is left out is the study's."""
        if isinstance(values, dict) and "strategy" not in values:
            asked = values.get("generator") == "vlm" or any(map(values.get, ("model", "replay", "start_from")))
            return {**values, "strategy": "study"} if asked else values
        return values

    @property
    def judging(self) -> Procedure:
        """The error rates of every verdict."""
        return Procedure(**{key: getattr(self, key) for key in Rates.model_fields})

    @property
    def generator_spec(self) -> Spec:
        """The generator with its own options."""
        return Spec(self.generator_name, self.generator_options)

    @property
    def simulator_spec(self) -> Spec:
        """The simulator with its options."""
        return Spec(self.simulator, self.simulator_options)

    def stack_spec(self) -> Spec | None:
        """Return the navigation stack under test; None for the simulator's own."""
        if self.stack is None and self.stack_options:
            return Spec(default_stack(self.simulator_options.get("profile")), self.stack_options)
        return None if self.stack is None else Spec(self.stack, self.stack_options)

    @property
    def generator_name(self) -> str:
        """The generator that is used."""
        if self.generator:
            return self.generator
        if self.start_from is not None:
            return "near"
        if self.strategy == "random":
            return "random"
        return "vlm" if self.model or self.replay else "heuristic"

    @property
    def folder(self) -> Path:
        """Return where the campaign is kept."""
        if self.out:
            return Path(self.out)
        world, requirement = Path(self.world).name, called(self.requirement)
        driver = f"-{self.stack}" if self.stack else ""
        name = f"{world}-{self.route}-{requirement}-{self.generator_name}-{self.strategy}-{self.seed}{driver}"
        return Path("runs") / safe_name(name)

    def deciding(self) -> dict[str, Any]:
        """Return the settings that decide the records, as data."""
        return {key: value for key, value in self.model_dump(mode="json").items() if key not in BESIDE}

    def to_yaml(self) -> str:
        """Return the configuration as a campaign file."""
        values = self.model_dump(mode="json", exclude={*OF_THE_CALL} - {"store", "store_options"})
        head = "# The effective configuration of this campaign; `rvsg run THIS_FILE --out ELSEWHERE` repeats it.\n"
        return head + yaml.safe_dump(values, sort_keys=False, allow_unicode=True)


@cache
def settings() -> dict[str, Setting]:
    """Return what is declared of every setting, by key; the one place that everything else is made from."""
    return {
        key: next(item for item in field.metadata if isinstance(item, Setting))
        for key, field in CampaignConfig.model_fields.items()
    }


def keys(**traits: Any) -> tuple[str, ...]:
    """Return the keys of the settings with these traits, e.g. `machine=True`."""
    return tuple(
        key
        for key, setting in settings().items()
        if all(getattr(setting, trait) == value for trait, value in traits.items())
    )


def value_type(key: str) -> type:
    """Return the type of a setting's value: bool, int, float, str, list or dict."""
    annotation: Any = CampaignConfig.model_fields[key].annotation
    while get_origin(annotation) in (Annotated, Union, types.UnionType):
        annotation = next(option for option in get_args(annotation) if option is not types.NoneType)
    kind = get_origin(annotation) or annotation
    return str if kind is Literal else kind


def default_of(key: str) -> Any:
    """Return the default of a setting."""
    return CampaignConfig.model_fields[key].get_default(call_default_factory=True)


def default_text(key: str) -> str:
    """Return the default of a setting in words; empty where there is none."""
    default = default_of(key)
    if settings()[key].default or default in (None, [], {}):
        return settings()[key].default
    return str(default).lower() if isinstance(default, bool) else str(default)


def option_of(key: str) -> str:
    """Return the option of the command line that gives a setting, e.g. `--base-url`."""
    name = key.removesuffix("s") if value_type(key) is dict else key
    return settings()[key].option or f"--{name.replace('_', '-')}"


MACHINE = keys(machine=True)
"""Keys of the machine, not of the campaign: where and by how many workers runs are made."""
BUDGETS = ("budget_calls", "budget_tokens", "budget_usd")
"""Keys that limit what the calls of a model cost."""
BESIDE = keys(decides=False)
"""Keys that do not decide the records and may differ when a campaign is resumed."""
OF_THE_CALL = (*MACHINE, "out", "store", "store_options", "junit", "fail_on_violation")
"""Keys that say how one call runs, and what else it writes or answers; a folder remembers all others."""
LISTED = keys(several=True)
"""Keys with which several values ask for several campaigns."""
VLM_OPTIONS = keys(of_model=True, decides=True)
"""Keys that say how a model is asked."""
FILES = tuple(key for key, setting in settings().items() if setting.file and setting.decides)
"""Keys whose value may name a file or a folder that the records depend on."""


Names = Annotated[list[str], Field(min_length=1), BeforeValidator(lambda v: v if isinstance(v, list) else [v])]


class CampaignFile(CampaignConfig):
    """The keys of a campaign file: those of `CampaignConfig`, with one or more routes and requirements."""

    route: Names = Field(default_factory=lambda: ["route_1"])  # type: ignore[assignment]
    requirement: Names = Field(default_factory=lambda: ["R1"])  # type: ignore[assignment]


def read_campaign_file(path: Path) -> dict[str, Any]:
    """Return the settings of a campaign file, checked, with paths relative to the current folder.

    Raises:
        DocumentError: every mistake with its line; a misspelt key comes with a suggestion.
    """
    return _settings(read_yaml(path), path)


def remembered(path: Path) -> dict[str, Any]:
    """Return the settings that decide no record, such as `shrink_runs`, from the campaign file in a folder."""
    content = read_yaml(path).value if path.is_file() else None
    return {
        key: content[key] for key in BESIDE if isinstance(content, dict) and key in content and key not in OF_THE_CALL
    }


def parse_campaign_file(text: str, path: Path) -> dict[str, Any]:
    """Return the settings of the text of a campaign file, checked as `read_campaign_file` does.

    Args:
        path: where the file lies or will lie; its paths are relative to it.
    """
    return _settings(parse_yaml(text, path), path)


def _settings(document: Document, path: Path) -> dict[str, Any]:
    if document.value is None:
        return {}
    validated(document, CampaignFile)
    values = dict(document.value)
    for key in keys(file="path"):
        if isinstance(values.get(key), str):
            values[key] = str(path.parent / values[key])
    for key in keys(file="or name"):
        if isinstance(values.get(key), list):
            values[key] = [_beside(path, name) for name in values[key]]
        elif isinstance(values.get(key), str):
            values[key] = _beside(path, values[key])
    stack = values.get("simulator_options", {}).get("stack")
    if isinstance(stack, str):
        values["simulator_options"] = {**values["simulator_options"], "stack": _beside(path, stack)}
    return values


def _beside(path: Path, name: str) -> str:
    """Return a name as it stands, or as a path where such a file exists beside the campaign file."""
    shipped = name in {*shipped_worlds(), *shipped_requirements(), *shipped_robots(), *plugins.names("stack")}
    return name if shipped or not (path.parent / file_of(name)).exists() else as_named(path.parent / name)


def called(requirement: str) -> str:
    """Return the name of a requirement in its file, or else that of the file."""
    file = file_of(requirement)
    return requirement[len(file) + 1 :] or Path(file.removesuffix(".yaml").removesuffix(".yml")).name


def safe_name(name: str) -> str:
    """Return a name that is safe for a folder."""
    return re.sub(r"[^\w.+-]+", "_", name)


def file_of(reference: str) -> str:
    """Return the file in `my.yaml#name`, `my.yaml:name` or `my.py:Class`; all of it where it names no part."""
    return re.sub(r"(\.(?:ya?ml|py))[#:].*", r"\1", reference)


OF_START = frozenset({"world", "route", "robot", "humans"})
"""The settings that a scenario to start from stands for."""


def of_start(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return settings with those that a scenario to start from stands for, where they are left out.

    Raises:
        FileError: the file holds no scenario.
    """
    path, left_out = values.get("start_from"), OF_START - values.keys()
    if not isinstance(path, str) or not left_out:
        return dict(values)
    from rvsg.scenario.builder import load_scenario_in
    from rvsg.scenario.world_lookup import folder_of

    scenario, _ = load_scenario_in(path, values.get("world"))
    mission, robot = scenario.mission, scenario.mission.robot
    of_scenario = {
        "world": str(folder_of(mission.world_id) or mission.world),
        "route": mission.route.name,
        "robot": robot if isinstance(robot, str) else robot.name,
        "humans": max(1, len(scenario.people.humans)),
    }
    return {**values, **{key: of_scenario[key] for key in left_out}}


def effective(stored: dict[str, Any] | None, from_file: dict[str, Any], from_options: dict[str, Any]) -> CampaignConfig:
    """Return the configuration: the stored settings or the defaults, then the file, then the options."""
    values = {**(stored or {}), **from_file, **from_options}
    try:
        return CampaignConfig(**of_start(values))
    except pydantic.ValidationError as error:
        empty = [e for e in error.errors() if e["loc"] and e["loc"][0] in BUDGETS and e["input"] in (0, "0")]
        messages = [f"{e['loc'][0]}: {NO_CALL}" for e in empty]
        messages += mistakes_of(error, CampaignConfig, noun="option", besides=[str(e["loc"][0]) for e in empty])
        raise InvalidOptions("; ".join(messages), keys_of(error)) from None
