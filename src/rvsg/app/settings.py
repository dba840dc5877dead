"""The settings of a campaign: defaults, then the campaign file, then the command line.

Every key of the file is an option of `rvsg run` with `-` for `_`, and the other way round. Paths in the file are
relative to the file.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import pydantic
import yaml
from pydantic import BeforeValidator, Field, model_validator

from rvsg.core.documents import Document, keys_of, mistakes_of, parse_yaml, read_yaml, validated
from rvsg.core.errors import InputError, InvalidOptions
from rvsg.core.plugins import Spec
from rvsg.core.records import Record
from rvsg.evaluation.verdict import DEFAULT, Procedure
from rvsg.generation.vlm.model import NO_CALL
from rvsg.robots.robot import DEFAULT_ROBOT
from rvsg.simulation.stacks.registry import DEFAULT_STACK, runs_own_code
from rvsg.world.world import State

Positive = Annotated[int, Field(ge=1, le=100_000, strict=True)]
NotNegative = Annotated[int, Field(ge=0, strict=True)]

PATHS = ("out", "prompts", "replay", "junit", "moved", "knowledge")
"""Keys whose value is a path. `world` and `requirement` are paths where such a file exists beside the campaign file."""
MACHINE = ("jobs", "executor", "executor_options")
"""Keys of the machine, not of the campaign: where and by how many workers runs are made."""
BUDGETS = ("budget_calls", "budget_tokens", "budget_usd")
"""Keys that limit what the calls of a model cost."""
BESIDE = (*MACHINE, "store", "store_options", "out", "fail_on_violation", "junit", "shrink_runs", *BUDGETS)
"""Keys that do not decide the records and may differ when a campaign is resumed."""


class CampaignConfig(Record):
    """Every setting of `rvsg run`.

    `strategy` left out is `study` where a vision language model writes (it was not compared with others there).
    `generator` None is `random` for the strategy `random`, `vlm` where a model or a replay is named, else `heuristic`.
    `jobs` None is one per core. `out` None is a folder under `runs/` named for the settings.
    """

    world: str = "warehouse"
    route: str = "route_1"
    requirement: str = "R1"
    also: list[str] = Field(default_factory=list)
    robot: str = DEFAULT_ROBOT
    moved: Annotated[str | None, Field(min_length=1)] = None
    doors: dict[str, State] = Field(default_factory=dict)
    knowledge: Annotated[str | None, Field(min_length=1)] = None
    generator: str | None = None
    generator_options: dict[str, Any] = Field(default_factory=dict)
    strategy: str = "hybrid"
    simulator: str = "embedded"
    simulator_options: dict[str, Any] = Field(default_factory=dict)
    stack: str | None = None
    stack_options: dict[str, Any] = Field(default_factory=dict)
    humans: Annotated[int, Field(ge=1, le=100)] = 2
    scenarios: Positive = 10
    refinements: Annotated[int, Field(ge=0, le=1000)] = 4
    repeats: Positive = 5
    confirmations: Annotated[int, Field(ge=0, le=100_000)] = 250
    shrink_runs: Annotated[int, Field(ge=0, le=1_000_000)] = 200
    budget_runs: Annotated[int | None, Field(ge=1, le=10_000_000)] = None
    memory: Annotated[int, Field(ge=0, le=1000)] = 10
    max_in_flight: Annotated[int, Field(ge=1, le=1000)] = 1
    error_rate: Annotated[float, Field(gt=0, lt=0.5)] = DEFAULT.error_rate
    rare: Annotated[float, Field(gt=0, lt=0.5)] = DEFAULT.rare
    often: Annotated[float, Field(gt=0, lt=0.5)] = DEFAULT.often
    confidence: Annotated[float, Field(gt=0.5, lt=1)] = DEFAULT.confidence
    seed: NotNegative = 0
    jobs: Annotated[int | None, Field(ge=1, le=1024)] = None
    executor: str = "processes"
    executor_options: dict[str, Any] = Field(default_factory=dict)
    store: str = "sqlite"
    store_options: dict[str, Any] = Field(default_factory=dict)
    out: Annotated[str | None, Field(min_length=1)] = None
    fail_on_violation: bool = False
    junit: str | None = None
    model: str | None = None
    base_url: str | None = None
    conversation: Literal["compact", "study"] = "compact"
    prompts: str | None = None
    replay: str | None = None
    budget_usd: Annotated[float | None, Field(gt=0)] = None
    budget_calls: Annotated[int | None, Field(ge=1)] = None
    budget_tokens: Annotated[int | None, Field(ge=1)] = None

    @model_validator(mode="before")
    @classmethod
    def _usual_strategy(cls, values: Any) -> Any:
        """Return where a model writes, a strategy that is left out is the study's."""
        if isinstance(values, dict) and "strategy" not in values:
            asked = values.get("generator") == "vlm" or values.get("model") or values.get("replay")
            return {**values, "strategy": "study"} if asked else values
        return values

    @model_validator(mode="after")
    def _rates_apart(self) -> Self:
        if self.rare >= self.often:
            raise ValueError(f"rare ({self.rare:g}) must be smaller than often ({self.often:g})")
        return self

    @property
    def judging(self) -> Procedure:
        """The error rates of every verdict."""
        return Procedure(error_rate=self.error_rate, rare=self.rare, often=self.often, confidence=self.confidence)

    @property
    def generator_spec(self) -> Spec:
        """The generator with its own options."""
        return Spec(self.generator_name, self.generator_options)

    @property
    def simulator_spec(self) -> Spec:
        """The simulator with its options."""
        return Spec(self.simulator, self.simulator_options)

    def stack_spec(self, paths: Mapping[str, str]) -> Spec | None:
        """Return the navigation stack under test; None for the simulator's own."""
        if self.stack is None and self.stack_options:
            return Spec(DEFAULT_STACK, self.stack_options)
        return None if self.stack is None else Spec(paths.get(self.stack, self.stack), self.stack_options)

    @property
    def generator_name(self) -> str:
        """The generator that is used."""
        if self.generator:
            return self.generator
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
        values = self.model_dump(mode="json", exclude={"out", *MACHINE, "junit", "fail_on_violation"})
        head = "# The effective configuration of this campaign; `rvsg run THIS_FILE --out ELSEWHERE` repeats it.\n"
        return head + yaml.safe_dump(values, sort_keys=False, allow_unicode=True)


Names = Annotated[list[str], Field(min_length=1), BeforeValidator(lambda v: v if isinstance(v, list) else [v])]


class CampaignFile(CampaignConfig):
    """The keys of a campaign file: those of `CampaignConfig`, with one or more routes and requirements."""

    route: Names = Field(default_factory=lambda: ["route_1"])  # type: ignore[assignment]
    requirement: Names = Field(default_factory=lambda: ["R1"])  # type: ignore[assignment]


def check_stack_named(stack: str | None, named: str | None) -> None:
    """Refuse a stack of a file or a store that runs code of its own, unless the user names one.

    Raises:
        InputError: says how to name it.
    """
    if stack is not None and runs_own_code(stack) and named is None:
        raise InputError(
            f"The settings name the stack {stack}, which runs code that is not installed. Nothing that a file names is "
            f"run by itself: name it on the command line, too, with --stack {shlex.quote(stack)}, or in Python with "
            "stack=."
        )


def read_campaign_file(path: Path) -> dict[str, Any]:
    """Return the settings of a campaign file, checked, with paths relative to the current folder.

    Raises:
        DocumentError: every mistake with its line; a misspelt key comes with a suggestion.
    """
    return _settings(read_yaml(path), path)


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
    for key in PATHS:
        if isinstance(values.get(key), str):
            values[key] = str(path.parent / values[key])
    for key in ("world", "requirement", "also", "robot", "stack"):
        if isinstance(values.get(key), list):
            values[key] = [_beside(path, name) for name in values[key]]
        elif isinstance(values.get(key), str):
            values[key] = _beside(path, values[key])
    return values


def _beside(path: Path, name: str) -> str:
    """Return a name as it stands, or as a path where such a file exists beside the campaign file."""
    return str(path.parent / name) if (path.parent / file_of(name)).exists() else name


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


def effective(stored: dict[str, Any] | None, from_file: dict[str, Any], from_options: dict[str, Any]) -> CampaignConfig:
    """Return the configuration: the stored settings or the defaults, then the file, then the options."""
    values = {**(stored or {}), **from_file, **from_options}
    try:
        return CampaignConfig(**values)
    except pydantic.ValidationError as error:
        empty = [e for e in error.errors() if e["loc"] and e["loc"][0] in BUDGETS and e["input"] in (0, "0")]
        messages = [f"{e['loc'][0]}: {NO_CALL}" for e in empty]
        messages += mistakes_of(error, CampaignConfig, noun="option", besides=[str(e["loc"][0]) for e in empty])
        raise InvalidOptions("; ".join(messages), keys_of(error)) from None
