"""The campaign's configuration: defaults, then the campaign file, then the command line.

Every key of the file is an option of `rvsg run` with `-` for `_`, and the other way round. Paths in the file are
relative to the file.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Any, Literal

import pydantic
import yaml
from pydantic import BeforeValidator, Field

from rvsg.core.documents import DocumentError, mistakes_of, read_yaml, validated
from rvsg.core.errors import FileError, InputError
from rvsg.core.records import Record
from rvsg.generation.vlm.budget import NO_CALL

Positive = Annotated[int, Field(ge=1, le=100_000, strict=True)]
NotNegative = Annotated[int, Field(ge=0, strict=True)]

PATHS = ("out", "prompts", "replay", "junit")
"""Keys whose value is a path; `world` and `requirement` are one where such a thing exists beside the file."""
MACHINE = ("jobs", "executor", "executor_options")
"""Keys of the machine, not of the campaign: where and by how many processes the runs are made."""
BUDGETS = ("budget_calls", "budget_tokens", "budget_usd")
"""Keys of what the calls of a model may cost."""
BESIDE = (*MACHINE, "store", "store_options", "out", "fail_on_violation", "junit", *BUDGETS)
"""Keys that do not decide the records: they may differ when a campaign is resumed."""


class CampaignConfig(Record):
    """Everything `rvsg run` can be told.

    `generator` None is chance for the strategy `random`, the VLM where a model or a replay is named, else the
    heuristic. `jobs` None is one per core. `out` None is a folder under
    `runs/` named for what is asked.
    """

    world: str = "warehouse"
    route: str = "route_1"
    requirement: str = "R1"
    generator: str | None = None
    generator_options: dict[str, Any] = Field(default_factory=dict)
    strategy: str = "study"
    simulator: str = "embedded"
    simulator_options: dict[str, Any] = Field(default_factory=dict)
    humans: Annotated[int, Field(ge=1, le=100)] = 2
    scenarios: Positive = 10
    refinements: Annotated[int, Field(ge=0, le=1000)] = 4
    repeats: Positive = 5
    confirmations: Annotated[int, Field(ge=0, le=100_000)] = 30
    memory: Annotated[int, Field(ge=0, le=1000)] = 10
    abreast: Annotated[int, Field(ge=1, le=1000)] = 1
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
        """Where the campaign is kept."""
        if self.out:
            return Path(self.out)
        world, requirement = Path(self.world).name, called(self.requirement)
        name = f"{world}-{self.route}-{requirement}-{self.generator_name}-{self.strategy}-{self.seed}"
        return Path("runs") / safe_name(name)

    def deciding(self) -> dict[str, Any]:
        """The settings that decide the records, as data."""
        return {key: value for key, value in self.model_dump(mode="json").items() if key not in BESIDE}

    def to_yaml(self) -> str:
        """The effective configuration as a campaign file."""
        values = self.model_dump(mode="json", exclude={"out", *MACHINE, "junit", "fail_on_violation"})
        head = "# The effective configuration of this campaign; `rvsg run THIS_FILE --out ELSEWHERE` repeats it.\n"
        return head + yaml.safe_dump(values, sort_keys=False, allow_unicode=True)


Names = Annotated[list[str], Field(min_length=1), BeforeValidator(lambda v: v if isinstance(v, list) else [v])]


class CampaignFile(CampaignConfig):
    """What a campaign file may say: as `CampaignConfig`, but of routes and requirements there may be several."""

    route: Names = Field(default_factory=lambda: ["route_1"])  # type: ignore[assignment]
    requirement: Names = Field(default_factory=lambda: ["R1"])  # type: ignore[assignment]


def read_campaign_file(path: Path) -> dict[str, Any]:
    """The keys that a campaign file sets, checked, with paths made relative to the present folder.

    DocumentError holds every mistake with its line; a misspelt key is answered with "did you mean".
    """
    document = read_yaml(path)
    if document.value is None:
        return {}
    validated(document, CampaignFile)
    values = dict(document.value)
    for key in PATHS:
        if isinstance(values.get(key), str):
            values[key] = str(path.parent / values[key])
    for key in ("world", "requirement"):
        if isinstance(values.get(key), list):
            values[key] = [_beside(path, name) for name in values[key]]
        elif key in values:
            values[key] = _beside(path, values[key])
    return values


def _beside(path: Path, name: str) -> str:
    """A name as it stands, or as a path where such a thing exists beside the campaign file."""
    return str(path.parent / name) if (path.parent / file_of(name)).exists() else name


def called(requirement: str) -> str:
    """What a requirement is called: its name in its file, or else that of the file."""
    file = file_of(requirement)
    return requirement[len(file) + 1 :] or Path(file.removesuffix(".yaml").removesuffix(".yml")).name


def safe_name(name: str) -> str:
    """A name as that of a folder."""
    return re.sub(r"[^\w.+-]+", "_", name)


def file_of(reference: str) -> str:
    """The file in `my.yaml#name` or `my.yaml:name`; the whole reference where it names no part."""
    return re.sub(r"(\.ya?ml)[#:].*", r"\1", reference)


def effective(stored: dict[str, Any] | None, from_file: dict[str, Any], from_options: dict[str, Any]) -> CampaignConfig:
    """The configuration: defaults or what the resumed campaign was begun with, then the file, then the options."""
    values = {**(stored or {}), **from_file, **from_options}
    try:
        return CampaignConfig(**values)
    except pydantic.ValidationError as error:
        nothing = [e for e in error.errors() if str(e["loc"][0]).startswith("budget_") and e["input"] in (0, "0")]
        told = [f"{e['loc'][0]}: {NO_CALL}" for e in nothing]
        known = {f"{e['loc'][0]}: " for e in nothing}
        told += [m for m in mistakes_of(error, CampaignConfig, noun="option") if not m.startswith(tuple(known))]
        raise InputError("; ".join(told)) from None


__all__ = ["CampaignConfig", "DocumentError", "FileError", "effective", "read_campaign_file"]
