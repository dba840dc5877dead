"""Command lines that repeat, resume or extend a campaign."""

from __future__ import annotations

import json
import shlex
from collections.abc import Sequence
from pathlib import Path

from rvsg.app.folder import BEST
from rvsg.app.settings import MACHINE, OF_START, OF_THE_CALL, CampaignConfig, option_of, settings
from rvsg.core.setting import RUNS, TEST
from rvsg.report.result import Result


def command_for(config: CampaignConfig, *, out: Path | None = None) -> str:
    """Return the command that repeats a campaign: every option that is not the default, and always the seed."""
    words = _options(config, without=("out", *MACHINE, "junit", "fail_on_violation", "seed"))
    words += ["--seed", str(config.seed)]
    if out is not None:
        words += ["--out", str(out)]
    return shlex.join(["rvsg", "run", *words])


def command_for_more(config: CampaignConfig, made: int) -> str:
    """Return the command for the same campaign with more confirmation runs, in a new folder: twice as many as `made`.

    Its search and its first confirmation runs are the same again, by their seeds. A recorded model is not called
    again.
    """
    default = CampaignConfig().confirmations
    runs, recorded = max(default, 2 * made), config.folder / "vlm"
    replay = str(recorded) if (recorded / "calls.jsonl").exists() else config.replay
    again = config.replace(confirmations=default, replay=replay)
    new_folder = config.folder.parent / f"{config.folder.resolve().name}-{runs}"
    return f"{command_for(again, out=new_folder)} --confirmations {runs}"


def resume_command(config: CampaignConfig, *, without: Sequence[str] = ()) -> str:
    """Return the command that resumes a campaign: its folder, and the options that are not stored with it."""
    keys = [key for key in CampaignConfig.model_fields if key not in OF_THE_CALL]
    words = _options(config, without=("out", "store", "store_options", *keys, *without))
    return shlex.join(["rvsg", "run", "--out", str(config.folder), *words])


def confirm_command(folder: Path, attempt: int) -> str:
    """Return the command that confirms a candidate."""
    return shlex.join(["rvsg", "confirm", str(folder), str(attempt)])


def next_commands(config: CampaignConfig, result: Result) -> dict[str, str]:
    """Return the commands of next steps, by the names that `rvsg.report.result` gives them."""
    folder, other = config.folder, _without_recording(config)
    scenarios = sum(entry.state == "confirmed" for entry in result.ranking)
    verdict = result.confirmed.verdict if result.confirmed else None
    runs = max(result.accounting.confirmation_runs, verdict.runs * scenarios if verdict else 0)
    return {
        "resume": resume_command(config),
        "contact": command_for(other.replace(requirement="no_contact")),
        "confirm": shlex.join(["rvsg", "confirm", str(folder)]),
        "more": command_for_more(config, runs),
        "keep": shlex.join(["rvsg", "suite", "add", str(folder / BEST), "--suite", "suite"]),
        "planner": shlex.join(["rvsg", "replay", str(folder), "--trace"]),
        "repeat": command_for(other.replace(seed=config.seed + 1)),
    }


def _without_recording(config: CampaignConfig) -> CampaignConfig:
    """Return the settings of another search in the same test: recorded replies answer only the search they are of."""
    if config.replay is None:
        return config
    keys = {key for key, setting in settings().items() if setting.group in (TEST, RUNS)}
    return CampaignConfig(**{key: getattr(config, key) for key in keys}, seed=config.seed)


def runs_command(scenario: str, config: CampaignConfig, *, seed: int, repeats: int, out: str) -> str:
    """Return the command that simulates a scenario of a campaign, whose file says with what."""
    words = ["rvsg", "simulate", scenario, "--seed", str(seed), "--repeats", str(repeats), "--out", out]
    return shlex.join([*words, *_code(config)])


def shrink_command(scenario: str, config: CampaignConfig, *, out: str) -> str:
    """Return the command that shrinks a scenario of a campaign, whose file says with what."""
    return shlex.join(["rvsg", "scenario", "shrink", scenario, "--out", out, *_code(config)])


def _code(config: CampaignConfig) -> list[str]:
    """Return the option for a stack that is code, which no file can allow."""
    stack = config.stack or ""
    return ["--stack", stack] if ":" in stack else []


def _options(config: CampaignConfig, *, without: Sequence[str]) -> list[str]:
    """Return the options of `rvsg run` that give these settings: those that are not the default, nor a scenario's."""
    words: list[str] = []
    of_start = OF_START if config.start_from else frozenset()
    writer = {key: getattr(config, key) for key in ("generator", "model", "replay")}
    defaults = CampaignConfig().model_copy(update={"strategy": CampaignConfig(**writer).strategy})
    for key, value in config.model_dump(mode="json").items():
        option = option_of(key)
        if key in without or (value == getattr(defaults, key) and key not in of_start):
            continue
        if isinstance(value, dict):
            for name, item in value.items():
                words += [option, f"{name}={item if isinstance(item, str) else json.dumps(item)}"]
        elif isinstance(value, list):
            words += [word for item in value for word in (option, item)]
        else:
            words += [option] if value is True else [option, str(value)]
    return words
