"""Several campaigns of one `rvsg run`: progress and results."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rvsg.cli.console import as_started, print_json, say

if TYPE_CHECKING:
    from rvsg.app.campaign import Campaign
    from rvsg.app.matrix import Matrix


def run_matrix(matrix: Matrix, *, as_json: bool) -> int:
    """Run or resume the campaigns of a matrix, show what they found, and return the exit code."""
    from rvsg.cli.interruption import interruptible
    from rvsg.core.errors import Interrupted
    from rvsg.core.outputs import check_writable

    started = time.monotonic()
    resume = as_started(matrix.resume_command)
    if junit := matrix.settings.get("junit"):
        check_writable(Path(junit))
    campaigns = matrix.create(say)
    _announce(matrix, campaigns, resume)
    try:
        with interruptible() as interruption:
            with interruption.at_once(f"Interrupted. Resume with: {resume}"):
                campaigns[0].prepare(say)
            failed = _run(matrix, campaigns, interruption.check)
    except KeyboardInterrupt:
        raise Interrupted(f"Interrupted; everything finished is stored. Resume with: {resume}") from None
    matrix.report()
    done = [each for each in campaigns if str(each.folder) not in failed]
    _show(matrix, campaigns, done, time.monotonic() - started, as_json=as_json)
    for folder, (message, _) in failed.items():
        say(f"{Path(folder).name}: not finished. {message}")
    if failed:
        say(f"Resume the others with: {resume}")
        return max(code for _, code in failed.values())
    for campaign in done:
        campaign.check_judged()
    violated = any(each.summary().violated for each in done)
    return 1 if matrix.settings.get("fail_on_violation") and violated else 0


def _announce(matrix: Matrix, campaigns: Sequence[Campaign], resume: str) -> None:
    count = len(campaigns)
    say(f"Campaigns in {matrix.folder}: {count}; {min(matrix.jobs, count)} run at a time.")
    if others := len(matrix.all_pairs) - count:
        say(f"{others} more in this folder are not part of this command; resume them with: {resume}")
    if share := matrix.budget:
        listed = ", ".join(f"--{key.replace('_', '-')} {value:g}" for key, value in share.items())
        say(f"The campaigns share the budget equally; each may spend: {listed}.")


def _run(matrix: Matrix, campaigns: Sequence[Campaign], check: Callable[[], None]) -> dict[str, tuple[str, int]]:
    """Run the campaigns; return message and exit code of those that failed, by their folder."""
    from rvsg.app.matrix import Ended
    from rvsg.cli.progress import CampaignProgress
    from rvsg.core.errors import RvsgError

    failed: dict[str, tuple[str, int]] = {}
    lines = {
        str(each.folder): CampaignProgress(each.plan, each.attempts(), check=check, name=each.folder.name)
        for each in campaigns
    }
    ended = 0
    for campaign, event in matrix.run(campaigns):
        check()
        if not isinstance(event, Ended):
            lines[str(campaign.folder)](event)
            continue
        ended += 1
        if event.error is None:
            campaign.report()
        elif isinstance(event.error, RvsgError):
            failed[str(campaign.folder)] = (str(event.error), event.error.exit_code)
        else:
            raise event.error
        state = "not finished" if event.error else "done"
        say(f"{campaign.folder.name}: {state} ({ended} of {len(campaigns)})")
    return failed


def _show(
    matrix: Matrix, campaigns: Sequence[Campaign], done: Sequence[Campaign], spent_s: float, *, as_json: bool
) -> None:
    from rvsg.app.folder import REPORT
    from rvsg.app.matrix import write_junit
    from rvsg.cli.tables import matrix_table

    if junit := matrix.settings.get("junit"):
        write_junit(Path(junit), done)
    if as_json:
        overview = {"out": str(matrix.folder), "report": str(matrix.folder / REPORT), "command": matrix.commands()}
        print_json({"campaigns": [result_in_matrix(each) for each in done], **overview})
    say(matrix_table([(each.plan, each.summary()) for each in done]))
    say(f"{len(done)} of {len(campaigns)} campaigns done in {spent_s:.0f} s; stored in {matrix.folder}")
    say(f"Reports: {matrix.folder / REPORT}")
    say(f"Repeat it with: {matrix.commands(as_started)}")


def result_in_matrix(campaign: Campaign) -> dict[str, object]:
    """Return what a campaign found, with its route and its requirement."""
    pair = {"route": campaign.plan.mission.route.name, "requirement": campaign.requirement.name}
    return campaign.result() | pair
