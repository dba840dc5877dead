"""`rvsg demo`: show a recorded campaign, or run it again without a model."""

from __future__ import annotations

import lzma
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rvsg.cli.console import print_json, say
from rvsg.cli.frame import verb
from rvsg.cli.options import AsJson, JobsPerCore
from rvsg.core.errors import InputError, UnknownName

if TYPE_CHECKING:
    from rvsg.report.result import Result

app = verb()

_RECORDINGS = Path(str(resources.files("rvsg.app"))) / "recordings"
STORED = "ledger.sqlite.xz"
"""The campaign as it was run with the recorded replies, runs included."""


@app.command()
def demo(
    name: Annotated[
        str | None, typer.Argument(help="The recorded campaign: a name of --list, or a folder. [the first of --list]")
    ] = None,
    listed: Annotated[bool, typer.Option("--list", help="List the shipped campaigns.")] = False,
    out: Annotated[str | None, typer.Option(help="Folder of the campaign. [runs/demo-NAME]")] = None,
    repeats: Annotated[int | None, typer.Option(min=1, help="Runs of each configuration. [as recorded]")] = None,
    confirmations: Annotated[int | None, typer.Option(min=0, help="Budget of confirmation runs. [as recorded]")] = None,
    jobs: JobsPerCore = None,
    strict: Annotated[
        bool, typer.Option("--strict", help="Stop where a prompt differs from the recorded one.")
    ] = False,
    simulate: Annotated[
        bool, typer.Option("--simulate", help="Simulate all runs now, as the options above do.")
    ] = False,
    json: AsJson = False,
) -> None:
    """Show a campaign whose scenarios a vision language model wrote: no model, no key, no network.

    Replies and runs are stored; RVSG judges them and writes the report, whose page replays the runs. With --simulate,
    only the replies are: RVSG reads, checks, simulates, judges and reports them now, and lists prompts and measurements
    that differ from the recorded ones.
    """
    from rvsg.app.folder import CONFIG, store_of
    from rvsg.app.settings import read_campaign_file
    from rvsg.cli.run import run_campaign_of

    if listed:
        recordings = list(shipped_recordings())
        print_json(recordings) if json else typer.echo("\n".join(recordings))
        return
    folder = recording_folder(name)
    chosen: dict[str, Any] = {"replay": str(folder), "out": out or str(Path("runs") / f"demo-{folder.name}")}
    asked = {"repeats": repeats, "confirmations": confirmations, "jobs": jobs}
    chosen |= {key: value for key, value in asked.items() if value is not None}
    if strict:
        chosen["generator_options"] = {"strict": True}
    if not (simulate or strict or len(chosen) > 2) and (folder / STORED).is_file():
        show_stored(folder, Path(chosen["out"]), as_json=json)
        return
    if store_of(Path(chosen["out"])) is not None and not Path(chosen["out"], CONFIG).exists():
        raise InputError(
            f"{chosen['out']} shows the stored campaign; these options make the runs now, in a folder of their own: "
            "add --out with a new one.",
            code="demo-shown",
        )
    say(f"Recorded campaign {folder.name}: a vision language model wrote the scenarios earlier; the runs are made now.")
    from_file = read_campaign_file(folder / "campaign.yaml")
    raise typer.Exit(run_campaign_of(from_file, chosen, as_json=json, remark=what_it_means))


def show_stored(recording: Path, out: Path, *, as_json: bool) -> None:
    """Copy the stored campaign of a recording into a folder, write its report and show the answer; compile nothing.

    Raises:
        FileError: The folder holds something else.
    """
    from rvsg.app.campaign import Campaign
    from rvsg.app.folder import LEDGER, check_out, store_of
    from rvsg.app.input_files import copy_inputs
    from rvsg.cli.tables import show_answer
    from rvsg.core.files import write_whole

    check_out(out)
    if store_of(out) is None:
        out.mkdir(parents=True, exist_ok=True)
        write_whole(out / LEDGER, lzma.decompress((recording / STORED).read_bytes()))
    copy_inputs({"replay": recording.name}, {recording.name: str(recording)}, out, anew=False)
    campaign = Campaign.open(out)
    if not campaign.finished:
        raise InputError(
            f"{out}: this campaign is not finished. Finish it: rvsg demo {recording.name} --simulate --out {out}. Or "
            "show the stored one in another folder.",
            code="demo-unfinished",
        )
    with campaign.result() as result:
        page = campaign.report(result=result)
        if as_json:
            print_json(campaign.data(result))
        version = campaign.record.provenance.version
        say(f"Recorded campaign {recording.name}: its runs are stored, made by RVSG {version}.")
        show_answer(result.answer, page=str(page), again=f"rvsg demo {recording.name} --simulate")
        say(what_it_means(result))


def shipped_recordings() -> tuple[str, ...]:
    """Return the names of the recorded campaigns that are installed; examples/recordings holds more."""
    return tuple(sorted(path.name for path in _RECORDINGS.iterdir()))


def recording_folder(name: str | None) -> Path:
    """Return the folder of a recorded campaign by its name or path, by default the first that is installed.

    Raises:
        UnknownName: There is neither such a name nor a folder with a campaign.yaml.
    """
    shipped = shipped_recordings()
    if name is not None and (Path(name) / "campaign.yaml").is_file():
        return Path(name)
    if name is not None and name not in shipped:
        raise UnknownName("recorded campaign", name, shipped, hint="A folder holds campaign.yaml and calls.jsonl.")
    return _RECORDINGS / (name or shipped[0])


def what_it_means(result: Result) -> str:
    """Return what the verdict says and what it does not say, for a reader who sees one for the first time."""
    from rvsg.evaluation.verdict import Status, counted, number, still_open
    from rvsg.report.answer_row import status_of

    confirmed, requirement = result.confirmed, result.requirement
    name = requirement.name
    tried = "the model's " + (counted(len(result.ranking), "scenario") if len(result.ranking) != 1 else "scenario")
    worst = f"the worst of {tried}" if len(result.ranking) != 1 else tried
    verdict = confirmed.verdict if confirmed is not None else None
    if verdict is None:
        return (
            f"What it means: the search ranked {tried}, and nothing was confirmed. The values above were selected for "
            "being bad, so they overstate the failure. --confirmations 20 confirms the worst one."
        )
    runs = counted(verdict.runs, "confirmation run")
    limit = number(requirement.limit, requirement.unit) if requirement.limit is not None else "its limit"
    said = {
        Status.PASS: (
            f"in {runs} of the worst scenario of the search, the robot kept {name} ({limit}). That holds for this "
            f"scenario only: {tried} did not violate the requirement, but another scenario may"
        ),
        Status.FAIL: (
            f"{worst} makes the robot violate {name} ({limit}) reliably, in {verdict.violations} of "
            f"{runs}. The report replays the runs"
        ),
        Status.FLAKY: (
            f"{worst} makes the robot violate {name} ({limit}) in some runs, {verdict.violations} of "
            f"{verdict.runs}, and not in others. The report replays them"
        ),
    }
    between = "always and sometimes" if still_open(verdict) else "always, sometimes and never"
    unsure = (
        f"{worst} violated {name} ({limit}) in {verdict.violations} of {runs}, which does not decide between "
        f"{between}. More runs can decide: add --confirmations 40 and a new --out"
    )
    return f"What {status_of(verdict)} means: {said.get(verdict.status, unsure)}."
