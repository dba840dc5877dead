"""Single proposals of a generator, the prompt that a campaign sends next, and requirements that a model drafts."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from pydantic import ValidationError

from rvsg.app.folder import CONFIG, reading, store_of
from rvsg.app.record import CampaignRecord
from rvsg.app.settings import CampaignConfig, effective, read_campaign_file
from rvsg.app.wiring import ABILITIES, Wired, let_rehearse, proposals_of, wire
from rvsg.core import plugins
from rvsg.core.documents import mistakes_of
from rvsg.core.errors import GenerationError, InputError
from rvsg.core.files import make_folder, write_whole
from rvsg.core.plugins import Spec
from rvsg.evaluation.metrics import METRICS
from rvsg.evaluation.signals import SIGNALS
from rvsg.evaluation.verdict import check_requirement, load_requirement
from rvsg.findings.ranking import search_attempts
from rvsg.generation.conversation import VlmGenerator
from rvsg.generation.generator import Generator, Proposal
from rvsg.generation.prompts import Dialogue, Prompts, template_text
from rvsg.generation.reply_json import NUMBER, TEXT, find_json, object_schema
from rvsg.generation.vlm.model import Message, Model, Picture, Scripted, estimated_tokens, picture_tokens
from rvsg.runs.ledger import CachedLedger, MemoryLedger
from rvsg.scenario.brief import Brief, Feedback
from rvsg.scenario.builder import check_route
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Mission
from rvsg.scenario.world_lookup import as_world
from rvsg.search.drive_alone import campaigns_of
from rvsg.search.strategies import single_brief
from rvsg.world.world import Route, World


def make_generator(given: str | Spec | Generator) -> Generator:
    """Return a generator given by name, by Spec or by itself."""
    if isinstance(given, str | Spec):
        spec = Spec.of(given)
        generator: Generator = plugins.make("generator", spec.name, spec.options)
    else:
        generator = given
    plugins.check_complete("generator", generator, Generator)
    return generator


def propose(
    world: World | str | Path,
    route: Route | str,
    requirement: str | Path | Requirement | None = "R1",
    *,
    generator: str | Spec | Generator = "heuristic",
    humans: int = CampaignConfig.model_fields["humans"].default,
    seed: int = 0,
    feedback: Feedback | None = None,
) -> Proposal:
    """Ask a generator for one scenario.

    Args:
        requirement: what the scenario should violate; None: none.
        feedback: what an earlier scenario measured; the proposal refines that one.

    Returns:
        The proposal. Its `scenario` is None if nothing valid came of it; `problems` says why.
    """
    place = as_world(world)
    taken = place.route(route) if isinstance(route, str) else route
    check_route(taken, place)
    brief = single_brief(
        Mission.of(place, taken),
        load_requirement(requirement, taken) if requirement is not None else None,
        humans=humans,
        seed=seed,
        feedback=feedback,
    )
    return make_generator(generator).propose(brief, place)


def propose_as(wired: Wired, *, unguided: bool = False, feedback: Feedback | None = None) -> Proposal:
    """Ask the generator of checked settings for one scenario."""
    plan = wired.plan
    requirement = None if unguided else plan.requirement
    brief = single_brief(plan.mission, requirement, humans=plan.humans, seed=plan.seed, feedback=feedback)
    return wired.generator.propose(brief, wired.world)


_NO_MODEL: dict[str, Any] = {
    **{"generator": "heuristic", "model": None, "base_url": None, "prompts": None, "replay": None},
    **{"generator_options": {}, "budget_usd": None, "budget_calls": None, "budget_tokens": None},
}


@dataclass(frozen=True, kw_only=True)
class NextPrompt:
    """What a model would be asked next."""

    brief: Brief
    world: World
    messages: tuple[Message, ...]
    shown: tuple[Picture, ...]
    """The pictures that the messages refer to."""
    own_templates: tuple[str, ...]
    """Names of the templates that replace shipped ones."""

    @property
    def pictures(self) -> int:
        """The number of pictures in the messages."""
        return sum(len(message.pictures) for message in self.messages)

    @property
    def tokens(self) -> int:
        """The estimated number of input tokens."""
        shown = [picture for message in self.messages for picture in message.pictures]
        texts = sum(estimated_tokens(message.text) for message in self.messages)
        return texts + sum(picture_tokens(picture.width, picture.height) for picture in shown)


def configured(campaign: Path | None, given: Mapping[str, Any]) -> CampaignConfig:
    """Return the configuration of a campaign file, or of the folder of a campaign, with options on top."""
    if campaign is None:
        return effective(None, {}, dict(given))
    file = campaign / CONFIG if campaign.is_dir() else campaign
    out = {"out": str(campaign)} if campaign.is_dir() else {}
    return effective(None, {**read_campaign_file(file), **out}, dict(given))


def templates_folder(config: CampaignConfig, prompts: Path | None = None) -> Path:
    """Return the folder in which a campaign's own prompt templates are."""
    return prompts or (Path(config.prompts) if config.prompts else config.folder / "prompts")


def next_prompt(config: CampaignConfig, prompts: Path | None = None) -> NextPrompt:
    """Return what the model would be asked next in a campaign.

    Args:
        prompts: A folder of templates that replace the shipped ones.

    Raises:
        InputError: the search of the campaign is finished.
    """
    folder = templates_folder(config, prompts)
    chosen = prompts is not None or bool(config.prompts)
    brief, wired = _next_brief(config)
    own = folder if chosen or folder.is_dir() else None
    generator = VlmGenerator(Scripted([]), conversation=config.conversation, prompts=own)
    let_rehearse(generator, wired.simulator, wired.world, seed=config.seed, kept=config.folder / ABILITIES)
    return NextPrompt(
        brief=brief,
        world=wired.world,
        messages=generator.first_prompts(brief, wired.world),
        shown=generator.pictures(brief, wired.world),
        own_templates=tuple(generator.prompts.overridden()),
    )


def _next_brief(config: CampaignConfig) -> tuple[Brief, Wired]:
    """Return the brief a campaign asks for next: from its ledger where it has one, else the first."""
    wired = wire(config.model_copy(update=_NO_MODEL))
    plan = wired.plan.replace(proposals=proposals_of(config))
    if store_of(config.folder) is None:
        return wired.strategy(CachedLedger(MemoryLedger()), plan).ask()[0].brief, wired
    with reading(config.folder) as ledger:
        names = campaigns_of(ledger)
        record = CampaignRecord.read(ledger.settings(names[0]) or {}) if names else None
        strategy = wired.strategy(CachedLedger(ledger), plan, record.strategy if record else None)
        for attempt in search_attempts(list(ledger.attempts(names[0] if names else wired.plan.name))):
            strategy.tell(attempt)
        asks = [ask for ask in strategy.ask() if ask.proposal is None]
    if not asks:
        raise InputError(
            f"{config.folder}: no question to a model comes next. The search is finished, or it runs known "
            "configurations again."
        )
    return asks[0].brief, wired


def copy_template(name: str, folder: Path) -> Path:
    """Copy a shipped prompt template into a folder, to be changed there; return its path.

    Raises:
        InputError: there is such a file already.
    """
    path = folder / f"{name}.md.j2"
    if path.exists():
        raise InputError(f"{path} exists already and is not overwritten.")
    text = template_text(name)
    make_folder(folder, option="--to")
    write_whole(path, text)
    return path


def write_pictures(prompt: NextPrompt, folder: Path) -> list[Path]:
    """Write the pictures of a prompt into a folder; return their paths."""
    make_folder(folder, option="--pictures")
    written = []
    for picture in prompt.shown:
        path = folder / f"{picture.name.replace(' ', '_')}.png"
        path.write_bytes(picture.png)
        written.append(path)
    return written


ANSWERS = 3
"""Answers of the model, of which all but the first correct what the schema refused."""
REQUIREMENT_SHAPE = object_schema(
    {
        **dict.fromkeys(("name", "title", "text", "metric", "formula"), TEXT),
        "worse": {"type": "string", "enum": ["smaller", "larger"]},
        "limit": {"anyOf": [NUMBER, {"type": "null"}]},
        "source": TEXT,
    }
)


def draft_requirement(words: str, model: Model) -> Requirement:
    """Return the requirement that a model writes for some words, checked as one of a file is.

    Raises:
        GenerationError: the model answers with none that can be measured, or says that nothing measures it.
    """
    facts = {"words": words, "metrics": list(METRICS.values()), "signals": list(SIGNALS.values())}
    dialogue = Dialogue(model, Prompts(), "requirement", facts, ())
    answer, problem = dialogue.ask("draft", "requirement", shape=REQUIREMENT_SHAPE), ""
    for number in range(1, ANSWERS + 1):
        try:
            return _requirement_of(answer.text)
        except ValidationError as error:
            problem = "; ".join(mistakes_of(error, Requirement))
        except InputError as error:
            problem = str(error)
        if number < ANSWERS:
            answer = dialogue.ask("correct", "reply-unreadable", shape=REQUIREMENT_SHAPE, problem=problem)
    raise GenerationError(f"The model {model.name} wrote no requirement in {ANSWERS} answers: {problem}")


def _requirement_of(text: str) -> Requirement:
    """Return the requirement of an answer; raises InputError or ValidationError where it cannot be used."""
    objects = [part.value for part in find_json(text) if isinstance(part.value, dict)]
    if not objects:
        raise InputError("It holds no JSON object.")
    values: dict[str, Any] = {key: value for key, value in objects[-1].items() if value not in ("", None)}
    if not values.keys() & {"metric", "formula"}:
        raise GenerationError(f"Nothing measures this requirement: {values.get('text', 'the model gives no reason')}")
    if "formula" in values:
        values.pop("worse", None)
    elif "limit" not in values:
        raise InputError("A metric needs a limit.")
    name = re.sub(r"\W+", "_", str(values.pop("name", "")).casefold()).strip("_")
    return check_requirement(Requirement.model_validate({"name": name, **values}))


def write_requirement(requirement: Requirement, file: Path) -> Requirement:
    """Write a requirement that was accepted into a new file, and return it as the file is read."""
    if file.exists():
        raise InputError(f"{file} exists. Choose another file with --out.")
    fields = requirement.model_dump(mode="json", exclude_defaults=True, exclude={"name"})
    write_whole(file, yaml.safe_dump({requirement.name: fields}, sort_keys=False, allow_unicode=True))
    return load_requirement(str(file))
