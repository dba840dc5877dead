"""The record of a campaign: its plan, how it is judged, its plug-ins, and where it came from.

A campaign stores paths as they were typed, and the folder it was begun in, which relative paths are read from.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Self

from pydantic import ValidationError

import rvsg
from rvsg.app.settings import FILES, CampaignConfig, file_of
from rvsg.campaign.attempt import Plan
from rvsg.campaign.ledger import Ledger
from rvsg.core.errors import InputError, InvalidOptions, UnknownName
from rvsg.core.plugins import Spec
from rvsg.core.records import Record
from rvsg.evaluation.verdict import DEFAULT, Procedure
from rvsg.robots.robot import shipped_robots
from rvsg.scenario.requirement import shipped_requirements
from rvsg.world.world_folder import shipped_worlds


def _with_its_people(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return the stored settings of a campaign, with the people of 0.2 where it began with them as the default."""
    config = dict(settings["config"])
    options = dict(dict(settings["simulator"]).get("options") or {})
    if options.get("profile") == "default" and "human_model" not in options:
        config["simulator_options"] = {**config.get("simulator_options", {}), "human_model": "social-force"}
    return config


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

        Raises:
            InputError: the record cannot be read, e.g. because a newer version wrote it.
        """
        if "plan" not in settings or "config" not in settings:
            return None
        try:
            config = CampaignConfig.model_validate(_with_its_people(settings))
            return cls.model_validate({**settings, "config": config.deciding()})
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


def changed_settings(known: CampaignRecord, asked: CampaignRecord) -> dict[str, str]:
    """Return the settings of a resumed campaign that would decide other records, as `differences` does."""
    stored, wanted = (record.model_dump(mode="json", exclude={"provenance"}) for record in (known, asked))
    # What follows from the options is listed only where no option differs.
    return differences(stored["config"], wanted["config"]) or differences(stored, wanted)


def record_in(ledger: Ledger, where: Path, name: str | None = None) -> CampaignRecord:
    """Return the record of the campaign in a store; by default of its only one."""
    records = {known: record for known in ledger.campaigns() if (record := _record(ledger, known))}
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


def paths_of(values: Mapping[str, Any], begun_in: str | None) -> dict[str, str]:
    """Return the typed paths among settings, each with where it is, seen from the current folder."""
    if begun_in is None:
        return {}
    shipped = {*shipped_worlds(), *shipped_requirements(), *shipped_robots()}
    here = Path(begun_in) == Path.cwd()
    found = {}
    for key in FILES:
        for text in _texts(values.get(key)):
            path = Path(begun_in) / text
            if text not in shipped and Path(file_of(str(path))).exists():
                found[text] = text if here else str(path)
    return found


def as_stored(asked: Mapping[str, Any], known: Mapping[str, str]) -> dict[str, Any]:
    """Return settings with every path as the stored campaign types it, where both name the same file.

    A path that is typed like a stored one but names another file here is made absolute, so that the two differ.
    """

    def typed(text: str) -> str:
        for kept, path in known.items():
            if _absolute(text) == _absolute(path):
                return kept
        return str(Path(text).absolute()) if text in known and Path(file_of(text)).exists() else text

    return {
        key: value
        if key not in FILES or value is None
        else [typed(text) for text in value]
        if isinstance(value, list)
        else typed(value)
        for key, value in asked.items()
    }


def spelled_out(values: Mapping[str, Any], known: Mapping[str, str]) -> dict[str, Any]:
    """Return settings whose paths hold from every folder."""
    shipped = {*shipped_worlds(), *shipped_requirements(), *shipped_robots()}

    def spelled(text: str) -> str:
        path = known.get(text, text)
        return text if text in shipped or not Path(file_of(path)).exists() else str(Path(path).absolute())

    return {key: spelled(v) if key in FILES and isinstance(v, str) else v for key, v in values.items()}


def _texts(value: Any) -> Iterable[str]:
    return [text for text in (value if isinstance(value, list) else [value]) if isinstance(text, str)]


def _absolute(text: str) -> str:
    """Return a path with its links resolved, and the name of a part of the file unchanged."""
    file = file_of(text)
    return f"{Path(file).resolve()}{text[len(file) :].replace(':', '#', 1)}"
