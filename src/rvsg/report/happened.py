"""Pictures of the run that represents a finding. They need no JavaScript."""

from __future__ import annotations

from typing import Any

import numpy as np
from markupsafe import Markup

from rvsg.evaluation.wording import outcome_in_words
from rvsg.report.facts import AttemptFacts, RunFacts
from rvsg.report.frames import frame, nearest_in_words, overview
from rvsg.report.names import narrow_names
from rvsg.report.shown import Shown, look_of
from rvsg.report.words import shown_at, untimed

STILLS = 4
APART_S = 0.8
"""Moments closer together than this look alike."""


def what_happens(shown: Shown, subject: AttemptFacts) -> dict[str, Any] | None:
    """Tell what happens in the run that represents the finding: sentences, an overview and frames."""
    run, which = _shown_run(shown, subject)
    if run is None:
        return None
    look = look_of(shown, subject)
    times = still_times(run)
    label = f"Way of the robot and of the people it meets, seed {run.run.seed}"
    return {
        "run": run,
        "which": which,
        "story": [
            {"t": sentence.time_s, "text": untimed(sentence), "address": f"#run={run.id}&t={shown_at(sentence.time_s)}"}
            for sentence in run.story
        ],
        "overview": Markup(overview(run.run, times, look, label, narrow_names(shown.floor))),  # noqa: S704
        "frames": [
            {
                "number": place,
                "t": t,
                "address": f"#run={run.id}&t={t:.1f}",
                "caption": caption(run, t),
                "svg": Markup(frame(run.run, t, look, caption(run, t))),  # noqa: S704
            }
            for place, t in enumerate(times, 1)
        ],
        "description": subject.attempt.proposal.scenario.description if subject.attempt.proposal.scenario else "",
    }


def _shown_run(shown: Shown, subject: AttemptFacts) -> tuple[RunFacts | None, str]:
    """Return the run that is told, and which one it is: the worst, or where none violates one with a contact."""
    kind = "confirmation run" if subject.attempt.purpose == "confirmation" else "search run"
    if not shown.summary.ranking and shown.summary.confirmed is None:
        kind = "run"  # of no campaign
    touched = [run for run in subject.runs if run.contacts]
    if touched and not subject.violating:
        run = max(touched, key=lambda each: max(contact.duration_s for contact in each.contacts))
        return run, f"the {kind} with the longest contact, seed {run.run.seed}"
    worst = subject.worst(shown.plan.requirement) or (subject.runs[0] if subject.runs else None)
    return worst, f"the worst {kind}, seed {worst.run.seed}" if worst is not None else ""


def still_times(run: RunFacts) -> list[float]:
    """Return up to four moments worth a picture, in order: the decisive one, the closest, a contact, the end."""
    t = run.run.trajectory.t
    end = float(t[-1])
    contact = [event.time_s for event in run.contacts[:1]]
    wanted = [run.decisive_s, *contact, run.closest_s, end, end / 2, end / 4]
    found: list[float] = []
    for time in wanted:
        if len(found) < STILLS and all(abs(time - other) >= APART_S for other in found):
            found.append(float(shown_at(float(time))))
    return sorted(found)


def caption(run: RunFacts, t_s: float) -> str:
    """Return what a frame shows, in words."""
    path = run.run.trajectory
    row = min(int(np.searchsorted(path.t, t_s - 1e-9)), len(path) - 1)
    speed = round(float(path.signed_speed[row]), 1) + 0.0  # no "-0.0"
    text = f"robot at {speed:.1f} m/s"
    if run.run.human_names:
        text += f", {nearest_in_words(run.run, t_s, '{who} is {gap} away')}"
    if row == len(path) - 1:
        text += f"; {outcome_in_words(run.run.outcome)}"
    return text
