"""The answer of a campaign in words: the verdict, and what else the runs show, each number with the runs it counts."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

from rvsg.campaign.attempt import Plan
from rvsg.evaluation.judge import still_open, violated
from rvsg.evaluation.verdict import Status, Verdict
from rvsg.evaluation.wording import OPEN, counted, difference_in_words, number, share_in_words
from rvsg.report.causes import Cause, Pair
from rvsg.report.facts import AttemptFacts, RunFacts
from rvsg.report.payload import INVOLVED_M
from rvsg.report.pieces import Badge, Piece, Sentence, ids_of, span_of
from rvsg.report.quantity import Why
from rvsg.report.seen import distinct_runs, elsewhere, seen_beside
from rvsg.report.summary import Summary, interval
from rvsg.report.words import direction, quantity
from rvsg.scenario.requirement import Requirement


@dataclass(frozen=True, kw_only=True)
class Answer:
    """The top of the page."""

    tone: str
    chip: str
    text: str
    badges: list[Badge] = field(default_factory=list)
    sentences: list[Sentence] = field(default_factory=list)


def headline(plan: Plan, summary: Summary) -> dict[str, str]:
    """Return what a campaign found in one sentence, in a word (`chip`), and the `tone` in which it is shown."""
    confirmed = summary.confirmed.verdict if summary.confirmed else None
    name = plan.requirement.name
    if not summary.ranking:
        return {"tone": "quiet", "chip": "no result", "text": "No valid scenario has been simulated yet."}
    if confirmed is None:
        state = "complete" if summary.complete else "not finished"
        text = f"The search is {state}. No candidate is confirmed yet."
        return {"tone": "quiet", "chip": "not confirmed", "text": text}
    if confirmed.status is Status.UNJUDGED:
        text = f"{name} has no limit. The worst scenario measures {interval(confirmed, plan.requirement.unit)}."
        return {"tone": "quiet", "chip": "no limit", "text": text}
    runs = counted(confirmed.runs, "confirmation run")
    text = (
        f"The worst scenario violates {name} in {confirmed.violations} of {runs}."
        if confirmed.violations
        else f"The worst scenario violates {name} in none of {runs}."
    )
    if still_open(confirmed):
        text = f"{text.removesuffix('.')}; {OPEN} (INCONCLUSIVE)."
    chip = "violated" if still_open(confirmed) else confirmed.status.value
    return {"tone": tone_of(confirmed), "chip": chip, "text": text}


def tone_of(verdict: Verdict) -> str:
    """Return the tone of a verdict: bad where it is violated, good where it passed."""
    return "bad" if violated(verdict) else "good" if verdict.status is Status.PASS else "quiet"


def answer(
    plan: Plan,
    summary: Summary,
    confirmed: AttemptFacts | None,
    searched: Sequence[AttemptFacts],
    cause: Cause | None,
    others: Sequence[AttemptFacts] = (),
) -> Answer:
    """Return the top of the page: verdict, badges and sentences.

    Args:
        confirmed: The confirmation runs of the finding; None before a confirmation.
        searched: The configurations of the search.
        cause: What leaving people out does to the finding.
        others: The confirmations of other scenarios.
    """
    top = headline(plan, summary)
    if confirmed is None:
        runs = distinct_runs(searched)
        badges, sentences = seen_beside(runs, plan, "search run") if runs else ([], [])
        return Answer(**top, badges=badges, sentences=sentences)
    badges, seen = seen_beside(confirmed.runs, plan, "confirmation run", cause.nobody if cause is not None else None)
    why, because = _why(plan, cause) if cause is not None else ([], [])
    badges = [*why, *badges]
    where = _where(confirmed)
    recurs = cause is not None and cause.finding.about_people == "no"
    told = [*because, *where] if recurs else [*where, *because]  # who is near matters less where nobody is needed
    sentences = [*_judged(plan, confirmed), *told, *seen]
    return Answer(**top, badges=badges, sentences=[*sentences, *elsewhere(others, searched)])


def answer_of_runs(plan: Plan, facts: AttemptFacts) -> Answer:
    """Return the top of the page of runs that belong to no campaign."""
    verdict, requirement = facts.attempt.verdict, plan.requirement
    assert verdict is not None
    badges, seen = seen_beside(facts.runs, plan, "run")
    sentences = [*_judged(plan, facts, "run"), *_where(facts), *seen]
    if verdict.status is Status.UNJUDGED:
        text = f"{requirement.name} has no limit. The runs measure {interval(verdict, requirement.unit)}."
        return Answer(tone="quiet", chip="no limit", text=text, badges=badges, sentences=sentences)
    if verdict.runs == 1:
        text = f"The run {'violates' if verdict.violations else 'does not violate'} {requirement.name}"
    else:
        verb = "violates" if verdict.violations == 1 else "violate"
        text = f"{verdict.violations or 'None'} of {counted(verdict.runs, 'run')} {verb} {requirement.name}"
    text += f"; {OPEN} ({verdict.status.value})." if still_open(verdict) else "."
    chip = "violated" if still_open(verdict) else verdict.status.value
    return Answer(tone=tone_of(verdict), chip=chip, text=text, badges=badges, sentences=sentences)


def _judged(plan: Plan, confirmed: AttemptFacts, kind: str = "confirmation run") -> list[Sentence]:
    """Return how often the limit is violated, and by how much."""
    verdict, requirement = confirmed.attempt.verdict, plan.requirement
    if verdict is None or verdict.mean is None:
        return []
    limit = requirement.threshold
    if verdict.censored:
        late = f"{verdict.censored} of {counted(verdict.runs, 'run')}"
        middle = f"the median is {number(verdict.median, requirement.unit)}" if verdict.median is not None else ""
        measured = [
            Piece(f"{_quantity(requirement)}: beyond the time limit in "),
            Piece(late, ids_of(confirmed.not_arrived)),
            Piece(f"; {middle or 'so is the median'} ({direction(requirement)}"),
        ]
    else:
        measured = [
            Piece(f"{_quantity(requirement)}: "),
            Piece(number(verdict.mean, requirement.unit), ids_of(confirmed.runs)),
            Piece(f" on average over the runs ({direction(requirement)}"),
        ]
    measured.append(Piece(f"; the limit is {number(limit, requirement.unit)})." if limit is not None else ")."))
    worst = confirmed.worst(requirement)
    if worst is not None and worst.arrived and worst.measurement.objective is not None:
        value = number(worst.measurement.objective, requirement.unit)
        measured += [Piece(" The worst run measures "), Piece(value, (worst.id,), worst.decisive_s), Piece(".")]
    if not share_in_words(verdict):
        return [measured]
    bad = confirmed.violating
    often = [
        Piece(f"{requirement.name} is violated in "),
        Piece(f"{len(bad)} of {counted(len(confirmed.runs), kind)}", ids_of(bad or confirmed.runs)),
        Piece(f": {share_in_words(verdict)}."),
    ]
    return [often, measured]


def _quantity(requirement: Requirement) -> str:
    name = quantity(requirement)
    return name[:1].upper() + name[1:]


DECIDES: dict[Why, str] = {
    "limit": "The limit is first passed",
    "worst": "The worst value is reached",
    "time": "The robot loses most time",
    "share": "The momentary value is worst",
    "closest": "Robot and people are closest",
}


def _where(facts: AttemptFacts) -> list[Sentence]:
    """Return where and when the violating runs are decided, or all of them, and who is near then."""
    runs = facts.violating or facts.runs
    if not runs:
        return []
    why = Counter(run.decisive_why for run in runs).most_common(1)[0][0]
    if why == "closest" and not any(run.run.human_names for run in runs):
        return []
    told = [run for run in runs if run.decisive_why == why]
    many = "" if len(told) == len(runs) else f" in {len(told)} of {counted(len(runs), 'run')}"
    sentence = [Piece(f"{DECIDES[why]}{many} near {_near(told)}, {span_of([run.decisive_s for run in told])}")]
    return [[*sentence, *_who(told)]]


def _who(runs: Sequence[RunFacts]) -> Sentence:
    """Return who is nearest at the decisive moments, as the end of a sentence."""
    who = Counter(run.decisive_with for run in runs if run.decisive_with).most_common(1)
    if not who:
        people = any(run.run.human_names for run in runs)
        return [Piece(f"; nobody is within {INVOLVED_M:g} m of the robot then." if people else ".")]
    name, count = who[0]
    with_them = [run for run in runs if run.decisive_with == name]
    far = [run for run in runs if not run.decisive_with]
    sentence = [
        Piece("; the nearest person then is "),
        Piece(f"{name} in {count} of {counted(len(runs), 'run')}", ids_of(with_them)),
    ]
    if far:
        sentence += [Piece("; in "), Piece(str(len(far)), ids_of(far)), Piece(f" nobody is within {INVOLVED_M:g} m")]
    return [*sentence, Piece(".")]


def _near(runs: Sequence[RunFacts]) -> str:
    """Return where the robot is at the decisive moments: the one or two most frequent places, and the waypoints."""
    places = [place for place, _ in Counter(run.decisive_near for run in runs).most_common(2)]
    waypoints = [name for name, _ in Counter(run.decisive_at.waypoint for run in runs).most_common(2) if name]
    if places == waypoints or not waypoints:
        return " and ".join(places)
    return f"{' and '.join(places)} (waypoint{'s' if len(waypoints) > 1 else ''} {' and '.join(waypoints)})"


CAUSED = {
    "yes": ("bad", "caused by the people", "The people cause it."),
    "no": ("warn", "recurs without people", "It recurs without people, so this is not a finding about people."),
    "open": ("quiet", "cause open", "These runs do not show whether the people cause it."),
}


CAUSE_WORDS = {"yes": "yes", "no": "no, recurs without", "open": "open", "not violated": "–"}
"""Whether the people cause a violation, in the tables of findings."""


def _why(plan: Plan, cause: Cause) -> tuple[list[Badge], list[Sentence]]:
    """Return whether it was the people: the same seeds without them, and without each of them."""
    finding, nobody = cause.finding, cause.nobody
    if finding.about_people == "not violated":
        return [], []
    tone, badge, said = CAUSED[finding.about_people]
    if finding.also_alone:
        said = "It also happens without people, and these runs do not show whether people make it happen more often."
    compared = finding.compared
    if nobody is None or compared is None:
        return [Badge(tone=tone, text=badge)], [[Piece(said)]]
    badges = [Badge(tone=tone, text=badge, runs=ids_of(nobody.runs))]
    confidence = finding.verdict.confidence
    sentence = _alone(plan, nobody, said, difference_in_words(compared.difference, compared.interval, confidence))
    for pair in cause.each:
        with_all = sum(run.violated for run in pair.before)
        sentence += [
            Piece(f" Without {pair.without} it is violated in "),
            Piece(f"{len(pair.violating)} of {counted(len(pair.runs), 'run')}", ids_of(pair.runs)),
            Piece(f" (with everybody in {with_all})."),
        ]
    return badges, [sentence]


def _alone(plan: Plan, nobody: Pair, said: str, difference: str) -> Sentence:
    """Return what the mission without people shows on the same seeds."""
    if all(run.measurement.objective is None for run in nobody.runs):
        return [Piece(f"Without people, {plan.requirement.name} measures nothing: it is about the people themselves.")]
    violating = f"{len(nobody.violating)} of {counted(len(nobody.runs), 'run')}"
    return [
        Piece(f"{said} On the same seeds without people, the robot violates {plan.requirement.name} in "),
        Piece(violating, ids_of(nobody.violating or nobody.runs)),
        Piece(f" ({difference})."),
    ]
