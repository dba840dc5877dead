"""The record of a campaign: its plan, how it is judged, its plug-ins, and where it came from.

Paths are stored as they were typed; see `rvsg.app.input_files`.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self

from pydantic import Field, ValidationError

import rvsg
from rvsg.app.settings import CampaignConfig
from rvsg.core.errors import InputError, InvalidOptions, UnknownName
from rvsg.core.plugins import Spec
from rvsg.core.records import Record
from rvsg.evaluation.verdict import DEFAULT, Procedure
from rvsg.runs.attempt import Plan
from rvsg.runs.ledger import Ledger
from rvsg.simulation.stacks.stack_choice import DEFAULT_STACK, STUDY_STACK, default_stack


def _as_begun(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return the stored settings of a campaign, with the people and the stack of 0.2 where these were its defaults."""
    config, simulator = dict(settings["config"]), dict(settings["simulator"])
    options = dict(simulator.get("options") or {})
    if options.get("profile") == "default" and "human_model" not in options:
        config["simulator_options"] = {**config.get("simulator_options", {}), "human_model": "social-force"}
    stack = options.get("stack") or {"name": DEFAULT_STACK, "version": "1", "options": {}}
    if simulator.get("name") == "embedded" and (stack["name"], stack["version"]) == (DEFAULT_STACK, "1"):
        if (config.get("stack") or default_stack(options.get("profile"))) != STUDY_STACK:
            config |= {"stack": STUDY_STACK, "stack_options": stack["options"]}
        if "stack" in options:
            simulator["options"] = options | {"stack": {**stack, "name": STUDY_STACK}}
    return {**settings, "config": config, "simulator": simulator}


WORDS = ("title", "text", "unit", "measured_as", "note", "source")
"""Fields of a requirement that decide no verdict."""


class Provenance(Record):
    """Where a campaign came from. None of it decides a record."""

    begun_in: str | None = None
    """The folder that relative paths among the settings are read from."""
    version: str = ""
    """The version of RVSG that began it."""


class CampaignRecord(Record):
    """What is stored of a campaign before its first attempt."""

    plan: Plan
    judging: Procedure = DEFAULT
    """The error rates of every verdict."""
    generator: Spec
    strategy: Spec
    """With the options that tell its form from earlier ones."""
    simulator: Spec
    """With its effective options."""
    config: dict[str, Any]
    """The settings as they were given; paths as they were typed."""
    plugins: dict[str, str] = Field(default_factory=dict, exclude_if=lambda plugins: not plugins)
    """Distribution, version and content of the plug-ins that do not ship; empty also in records of 0.2."""
    provenance: Provenance = Provenance()

    @classmethod
    def of(
        cls, config: CampaignConfig, plan: Plan, strategy: Spec, simulator: Spec, plugins: dict[str, str], begun_in: str
    ) -> Self:
        """Return the record of a new campaign."""
        return cls(
            plugins=plugins,
            plan=plan,
            judging=config.judging,
            generator=config.generator_spec,
            strategy=strategy,
            simulator=simulator,
            config=config.deciding(),
            provenance=Provenance(begun_in=begun_in, version=rvsg.__version__),
        )

    @classmethod
    def read(cls, settings: Mapping[str, Any]) -> Self | None:
        """Return the record stored as the settings of a campaign; None if they are of an import or a script.

        Raises:
            InputError: the record cannot be read, e.g. because a newer version wrote it.
        """
        if "plan" not in settings or "config" not in settings:
            return None
        try:
            begun = _as_begun(settings)
            config = CampaignConfig.model_validate(begun["config"])
            return cls.model_validate({**begun, "config": config.deciding()})
        except (ValidationError, TypeError) as error:
            version = dict(settings.get("provenance") or {}).get("version", "another version of RVSG")
            raise InputError(
                f"The campaign was stored by {version}, and this version ({rvsg.__version__}) cannot read it. "
                f"Open it with that version, or choose another folder. ({error.__class__.__name__})",
                code="record-unreadable",
            ) from None

    @property
    def settings(self) -> CampaignConfig:
        """The settings, with defaults for what does not decide the records."""
        return CampaignConfig.model_validate(self.config)

    def data(self) -> dict[str, Any]:
        """Return the record as JSON-able data."""
        return self.model_dump(mode="json")

    def kept_words(self, now: CampaignRecord) -> tuple[CampaignRecord, tuple[str, ...]]:
        """Return `now` with this record's words, and which words of the requirement differ.

        The words of a requirement decide no verdict, and the name of a world decides no run, but records hold them:
        a resumed campaign keeps those it was begun with, and the form that its strategy had then.
        """
        then, asked = self.plan.requirement, now.plan.requirement
        differ = tuple(word for word in WORDS if getattr(then, word) != getattr(asked, word))
        plan = now.plan
        if differ and then.replace(**{word: getattr(asked, word) for word in WORDS}) == asked:
            plan = plan.replace(requirement=then)
        else:
            differ = ()
        mission = self.plan.mission
        if mission.replace(world=plan.mission.world) == plan.mission:
            plan = plan.replace(mission=mission, name=self.plan.name)
        same = self.strategy.name == now.strategy.name
        return now.replace(plan=plan, strategy=self.strategy if same else now.strategy), differ


def differences(known: Mapping[str, Any], asked: Mapping[str, Any], prefix: str = "") -> dict[str, str]:
    """Return the settings of a resumed campaign that differ from those asked, each with `known, now asked`."""
    changes: dict[str, str] = {}
    for key in sorted({*known, *asked}):
        a, b = known.get(key), asked.get(key)
        if isinstance(a, dict) and isinstance(b, dict):
            changes |= differences(a, b, f"{prefix}{key}.")
        elif a != b:
            same = isinstance(a, str) and str(Path(a).absolute()) == b  # `as_stored` names another content so
            changes[f"{prefix}{key}"] = f"{a!r}, whose content has changed since" if same else f"{a!r}, now {b!r}"
    return changes


def other_settings(where: object, found: Mapping[str, str]) -> InvalidOptions:
    """Return the error for a folder that was begun with other settings; `found` is from `differences`."""
    listed = "\n".join(f"  - {key}: {change}" for key, change in found.items())
    return InvalidOptions(
        f"{where}: what this folder holds was begun with other settings:\n{listed}\n"
        "To resume it, leave these options out. For a new campaign, choose another --out.",
        found,
        code="other-settings",
    )


def changed_settings(known: CampaignRecord, asked: CampaignRecord) -> dict[str, str]:
    """Return the settings of a resumed campaign that would decide other records, as `differences` does."""
    left_out = {"provenance"} if known.plugins else {"provenance", "plugins"}
    stored, wanted = (record.model_dump(mode="json", exclude=left_out) for record in (known, asked))
    # What follows from the options is listed only where no option differs.
    return differences(stored["config"], wanted["config"]) or differences(stored, wanted)


def record_in(ledger: Ledger, where: Path, name: str | None = None) -> CampaignRecord:
    """Return the record of the campaign in a store; by default of its only one."""
    records = {campaign: record for campaign in ledger.campaigns() if (record := _record(ledger, campaign))}
    if name is not None and name not in records:
        raise UnknownName("campaign", name, records, hint=f"Store: {where}.")
    if not records:
        raise no_campaign(where, len(ledger.campaigns()))
    if name is None and len(records) > 1:
        listed = ", ".join(records)
        raise InputError(
            f"{where}: this store holds {len(records)} campaigns. Name one of them: {listed}.",
            code="campaign-ambiguous",
        )
    return records[name or next(iter(records))]


def no_campaign(where: Path, others: int) -> InputError:
    """Return the error for a store without a campaign."""
    if others:
        return InputError(
            f"{where}: this store holds imported results or attempts of a script ({others}), and no campaign with a "
            f"record. Write the study's tables of imported results with: rvsg report {where} --tables DIR",
            code="imported-results",
        )
    return InputError(f"{where}: this store holds no campaign yet; `rvsg run --out DIR` makes one.")


def _record(ledger: Ledger, name: str) -> CampaignRecord | None:
    settings = ledger.settings(name)
    return CampaignRecord.read(settings) if settings is not None else None
