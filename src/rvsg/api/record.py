"""The record of a campaign: its plan, how it is judged, its plug-ins, and where it came from."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self

from pydantic import ValidationError

import rvsg
from rvsg.api.config import CampaignConfig, renamed
from rvsg.campaign.attempt import Ledger
from rvsg.campaign.plan import Plan
from rvsg.core.errors import InputError, InvalidOptions, UnknownName
from rvsg.core.plugins import Spec
from rvsg.core.records import Record
from rvsg.evaluation.verdict import DEFAULT, Procedure

FROM = "from"
"""The key under which RVSG 0.1 kept the folder a campaign was begun in."""
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
    provenance: Provenance = Provenance()

    @classmethod
    def of(cls, config: CampaignConfig, plan: Plan, strategy: Spec, simulator: Spec, begun_in: str) -> Self:
        """Return the record of a new campaign."""
        return cls(
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

        Records of RVSG 0.1 are read, too.

        Raises:
            InputError: the record cannot be read, e.g. because a newer version wrote it.
        """
        if "plan" not in settings or "config" not in settings:
            return None
        values = dict(settings)
        begun_in = values.pop(FROM, None)
        try:
            config = CampaignConfig.model_validate(renamed(values["config"]))
            values["config"] = config.deciding()
            values.setdefault("generator", config.generator_spec)
            values.setdefault("strategy", Spec(config.strategy))
            values.setdefault("provenance", Provenance(begun_in=begun_in, version="0.1"))
            return cls.model_validate(values)
        except (ValidationError, TypeError) as error:
            version = dict(values.get("provenance") or {}).get("version", "another version of RVSG")
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
    found: dict[str, str] = {}
    for key in sorted({*known, *asked}):
        a, b = known.get(key), asked.get(key)
        if isinstance(a, dict) and isinstance(b, dict):
            found |= differences(a, b, f"{prefix}{key}.")
        elif a != b:
            found[f"{prefix}{key}"] = f"{a!r}, now {b!r}"
    return found


def other_settings(where: object, found: Mapping[str, str]) -> InvalidOptions:
    """Return the error for a folder that was begun with other settings; `found` is from `differences`."""
    listed = "\n".join(f"  - {key}: {change}" for key, change in found.items())
    return InvalidOptions(
        f"{where}: what this folder holds was begun with other settings:\n{listed}\n"
        "To resume it, leave these options out. For a new campaign, choose another --out.",
        found,
        code="other-settings",
    )


def check_same(known: CampaignRecord, asked: CampaignRecord, where: object) -> None:
    """Refuse to resume a campaign with settings that decide other records."""
    ignored = {"provenance"}
    stored, wanted = (record.model_dump(mode="json", exclude=ignored) for record in (known, asked))
    # What follows from the options is listed only where no option differs.
    if found := differences(stored["config"], wanted["config"]) or differences(stored, wanted):
        raise other_settings(where, found)


def record_in(ledger: Ledger, where: Path, name: str | None = None) -> CampaignRecord:
    """Return the record of the campaign in a store; by default of its only one."""
    records = {known: record for known in ledger.campaigns() if (record := _record(ledger, known))}
    if name is not None:
        if name not in records:
            raise UnknownName("campaign", name, records, hint=f"Store: {where}.")
        return records[name]
    if not records:
        raise no_campaign(where, len(ledger.campaigns()))
    if len(records) > 1:
        listed = ", ".join(records)
        raise InputError(
            f"{where}: this store holds {len(records)} campaigns. Name one of them: {listed}.",
            code="campaign-ambiguous",
        )
    return next(iter(records.values()))


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
