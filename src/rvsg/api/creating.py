"""The settings of a campaign before it is created: plug-ins by name, what the folder holds, what cannot be used."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from rvsg.api.config import CampaignConfig, effective
from rvsg.api.folder import opened, store_of
from rvsg.api.paths import as_stored, paths_of
from rvsg.api.record import CampaignRecord
from rvsg.api.wiring import VLM_OPTIONS
from rvsg.core.errors import InputError
from rvsg.core.plugins import Spec


def instances_among(settings: dict[str, Any], **given: Any) -> dict[str, Any]:
    """Put plug-ins given by name or Spec among the settings, and return the instances by kind."""
    instances: dict[str, Any] = {}
    for kind, plugin in given.items():
        if plugin is None:
            continue
        if isinstance(plugin, str | Spec):
            spec = Spec.of(plugin)
            settings[kind] = spec.name
            if spec.options:
                settings[f"{kind}_options"] = spec.options
        else:
            instances[kind] = plugin
            settings[kind] = plugin.name or type(plugin).__name__
    return instances


def resumed(
    config: CampaignConfig, from_file: Mapping[str, Any], settings: Mapping[str, Any]
) -> tuple[CampaignRecord | None, CampaignConfig, dict[str, str]]:
    """Return the stored record of the folder, the settings on top of it, and where their paths are."""
    folder = config.folder
    known = store_of(folder)
    if known is None:
        return None, config, {}
    if config.store not in ("sqlite", known[0]):
        raise InputError(
            f"{folder}: its campaign is kept by the store {known[0]!r}, not {config.store!r}.", code="other-store"
        )
    with opened(folder, *known) as ledger:
        names = ledger.campaigns()
        kept = ledger.settings(names[0]) if names else None
    if kept is None:
        return None, config, {}
    stored = CampaignRecord.read(kept)
    if stored is None:
        raise InputError(
            f"{folder}: this folder holds imported results, no campaign. Choose another --out.", code="imported-results"
        )
    paths = paths_of(stored.config, stored.provenance.begun_in)
    values = stored.config | {"store": known[0], "store_options": known[1]}
    asked = effective(values, as_stored(from_file, paths), as_stored(settings, paths))
    return stored, asked, paths


def reject_unused_model_options(
    config: CampaignConfig, settings: Mapping[str, Any], on_message: Callable[[str], None]
) -> None:
    """Refuse options of a model where no model is asked; those of a campaign file only cause a message."""
    if config.generator_name == "vlm":
        return
    if unused := [f"--{key.replace('_', '-')}" for key in VLM_OPTIONS if settings.get(key) is not None]:
        raise InputError(
            f'{", ".join(unused)}: this campaign uses the generator "{config.generator_name}", and only "vlm" takes '
            "such options. Leave them out, or use --generator vlm.",
            code="model-options-unused",
        )
    if unused := [key for key in VLM_OPTIONS if getattr(config, key) not in (None, "compact")]:
        on_message(
            f'The generator is "{config.generator_name}": {", ".join(unused)} in the campaign file have no effect.'
        )
