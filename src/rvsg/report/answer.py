"""The answer of a campaign in words: the verdict, and what else the runs show, each number with the runs it counts."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from rvsg.campaign.plan import Plan
from rvsg.evaluation.judge import OPEN, still_open, violated
from rvsg.evaluation.naming import place_name
from rvsg.evaluation.story import at_place
from rvsg.evaluation.verdict import Status, Verdict
from rvsg.evaluation.wording import difference_in_words, share_in_words
from rvsg.report.causes import Cause, Pair
from rvsg.report.facts import AttemptFacts, RunFacts
from rvsg.report.payload import INVOLVED_M
from rvsg.report.quantity import Why
from rvsg.report.summary import Summary, counted, interval, number
from rvsg.report.words import direction, metres, quantity
from rvsg.scenario.requirement import Requirement


class Piece(NamedTuple):
    """A part of a sentence. With `runs` it is a link that opens them; `t_s` is the time at which it does."""

    text: str
    runs: tuple[str, ...] = ()
    t_s: float | None = None

    @property
    def address(self) -> str:
        """The part of the page's address that opens the runs in the replay."""
        if len(self.runs) == 1:
            return f"#run={self.runs[0]}" + (f"&t={self.t_s:.1f}" if self.t_s is not None else "")
        return "#runs=" + ",".join(self.runs)


Sentence = list[Piece]


@dataclass(frozen=True, kw_only=True)
class Badge:
    """A fact in two or three words beside the verdict. `tone` is bad, good, warn or quiet."""

    tone: str
    text: str
    runs: tuple[str, ...] = ()


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
        runs = _distinct(searched)
        badges, sentences = _seen(runs, plan, "search run") if runs else ([], [])
        return Answer(**top, badges=badges, sentences=sentences)
    badges, seen = _seen(confirmed.runs, plan, "confirmation run")
    why, because = _why(plan, cause) if cause is not None else ([], [])
    badges = [*why, *badges]
    where = _where(confirmed)
    recurs = cause is not None and cause.finding.about_people == "no"
    told = [*because, *where] if recurs else [*where, *because]  # who is near matters less where nobody is needed
    sentences = [*_judged(plan, confirmed), *told, *seen]
    return Answer(**top, badges=badges, sentences=[*sentences, *_elsewhere(others, searched)])


def _elsewhere(others: Sequence[AttemptFacts], searched: Sequence[AttemptFacts]) -> list[Sentence]:
    """Return in how many runs that are not of the finding robot and person touch, if they do in any."""
    sentence: Sentence = []
    for attempts, kind, which in (
        (others, "confirmation run", " of other configurations"),
        (searched, "run", " of the search"),
    ):
        runs = _distinct(attempts)
        touched = [run for run in runs if run.contacts]
        if touched:
            sentence += [
                Piece(" and in " if sentence else "Elsewhere in the campaign, robot and person touch in "),
                Piece(f"{len(touched)} of {counted(len(runs), kind)}", _ids(touched)),
                Piece(which),
            ]
    return [[*sentence, Piece(".")]] if sentence else []


def answer_of_runs(plan: Plan, facts: AttemptFacts) -> Answer:
    """Return the top of the page of runs that belong to no campaign."""
    verdict, requirement = facts.attempt.verdict, plan.requirement
    assert verdict is not None
    badges, seen = _seen(facts.runs, plan, "run")
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
            Piece(late, _ids(confirmed.not_arrived)),
            Piece(f"; {middle or 'so is the median'} ({direction(requirement)}"),
        ]
    else:
        measured = [
            Piece(f"{_quantity(requirement)}: "),
            Piece(number(verdict.mean, requirement.unit), _ids(confirmed.runs)),
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
        Piece(f"{len(bad)} of {counted(len(confirmed.runs), kind)}", _ids(bad or confirmed.runs)),
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
    sentence = [Piece(f"{DECIDES[why]}{many} near {_near(told)}, {_span([run.decisive_s for run in told])}")]
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
        Piece(f"{name} in {count} of {counted(len(runs), 'run')}", _ids(with_them)),
    ]
    if far:
        sentence += [Piece("; in "), Piece(str(len(far)), _ids(far)), Piece(f" nobody is within {INVOLVED_M:g} m")]
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
    badges = [Badge(tone=tone, text=badge, runs=_ids(nobody.runs))]
    confidence = finding.verdict.confidence
    sentence = _alone(plan, nobody, said, difference_in_words(compared.difference, compared.interval, confidence))
    for pair in cause.each:
        with_all = sum(run.violated for run in pair.before)
        sentence += [
            Piece(f" Without {pair.without} it is violated in "),
            Piece(f"{len(pair.violating)} of {counted(len(pair.runs), 'run')}", _ids(pair.runs)),
            Piece(f" (with everybody in {with_all})."),
        ]
    return badges, [sentence]


def _alone(plan: Plan, nobody: Pair, said: str, difference: str) -> Sentence:
    """Return what the mission without people shows on the same seeds."""
    if all(run.measurement.objective is None for run in nobody.runs):
        return [Piece(f"Without people, {plan.requirement.name} measures nothing: it is about the people themselves.")]
    return [
        Piece(f"{said} On the same seeds without people, the robot violates {plan.requirement.name} in "),
        Piece(f"{len(nobody.violating)} of {counted(len(nobody.runs), 'run')}", _ids(nobody.violating or nobody.runs)),
        Piece(f" ({difference})."),
    ]


def _seen(runs: Sequence[RunFacts], plan: Plan, kind: str) -> tuple[list[Badge], list[Sentence]]:
    """Return what the runs show besides the requirement: contacts, arrivals and the smallest gap."""
    badges, sentences = [], []
    total = counted(len(runs), kind)
    touched = [run for run in runs if run.contacts]
    people = any(run.closest_m is not None for run in runs)
    if touched:
        longest, in_longest = max(
            ((_measured(run, "contact_longest", c.duration_s), run) for run in touched for c in run.contacts),
            key=lambda pair: pair[0],
        )
        fastest, in_fastest = max(
            ((_measured(run, "contact_speed", c.closing_speed_m_s), run) for run in touched for c in run.contacts),
            key=lambda pair: pair[0],
        )
        badges.append(Badge(tone="bad", text=f"contact in {len(touched)} of {len(runs)} runs", runs=_ids(touched)))
        sentences.append(
            [
                Piece("Robot and person touch in "),
                Piece(f"{len(touched)} of {total}", _ids(touched)),
                Piece(f" ({_touched(touched)}); the longest contact lasts "),
                Piece(number(longest, "s"), (in_longest.id,), in_longest.contacts[0].time_s),
                Piece(", and the largest relative speed is "),
                Piece(number(fastest, "m/s"), (in_fastest.id,), in_fastest.contacts[0].time_s),
                Piece("."),
            ]
        )
    elif people:
        badges.append(Badge(tone="good", text=f"no contact in {counted(len(runs), 'run')}"))
    struck = [run for run in runs if run.obstacle_contacts]
    if struck:
        first = struck[0].obstacle_contacts[0]
        badges.append(Badge(tone="bad", text=f"hits an obstacle in {len(struck)} of {len(runs)}", runs=_ids(struck)))
        sentences.append(
            [
                Piece("The robot hits an obstacle in "),
                Piece(f"{len(struck)} of {total}", _ids(struck)),
                Piece(", first "),
                Piece(at_place(first.place), (struck[0].id,), first.time_s),
                Piece("."),
            ]
        )
    late = [run for run in runs if not run.arrived]
    if late:
        badges.append(Badge(tone="bad", text=f"{len(late)} of {len(runs)} did not arrive", runs=_ids(late)))
        limit = number(plan.mission.route.time_limit_s, "s")
        sentences.append(
            [
                Piece("The robot does not reach its goal in "),
                Piece(f"{len(late)} of {total}", _ids(late)),
                Piece(f" (time limit {limit})."),
            ]
        )
    else:
        badges.append(Badge(tone="good", text="all arrived"))
    met = [run for run in runs if run.closest_m is not None]
    nearest = min(met, key=lambda run: run.closest_m if run.closest_m is not None else 0.0, default=None)
    if nearest is not None and not touched:
        sentences.append(
            [
                Piece("The robot touches nobody; the smallest gap is "),
                Piece(metres(nearest.closest_m or 0.0), (nearest.id,), nearest.closest_s),
                Piece(f", to {nearest.closest_to} near {nearest.closest_near}, {_span([nearest.closest_s])}."),
            ]
        )
    return badges, sentences


def _touched(runs: Sequence[RunFacts]) -> str:
    """Return whom the robot touches most often, where, and when, in words."""
    first = [run.contacts[0] for run in runs]
    who, count = Counter(contact.person for contact in first).most_common(1)[0]
    theirs = [(run, contact) for run, contact in zip(runs, first, strict=True) if contact.person == who]
    near = Counter(place_name(run.world, contact.place.x, contact.place.y) for run, contact in theirs)
    often = "" if count == len(runs) else f" in {count}"
    return f"{who}{often}, near {near.most_common(1)[0][0]}, {_span([contact.time_s for _, contact in theirs])}"


def _span(times: Sequence[float]) -> str:
    """Return between which times after the start something happens, in words."""
    low, high = min(times), max(times)
    when = f"{low:.0f} s" if round(low) == round(high) else f"{low:.0f} to {high:.0f} s"
    return f"{when} after the start"


def _measured(run: RunFacts, metric: str, otherwise: float) -> float:
    """Return the metric of a run, which the terminal and the JSON report, too."""
    value = run.measurement.values.get(metric)
    return otherwise if value is None else value


def _distinct(attempts: Iterable[AttemptFacts]) -> list[RunFacts]:
    """Return every run of some attempts once."""
    return list({run.id: run for attempt in attempts for run in attempt.runs}.values())


def _ids(runs: Iterable[RunFacts]) -> tuple[str, ...]:
    return tuple(run.id for run in runs)
