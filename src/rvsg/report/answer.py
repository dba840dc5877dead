"""Words for requirements on the page and in the terminal."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from string import Formatter
from typing import Any, NamedTuple

from rvsg.campaign.attempt import Plan
from rvsg.campaign.findings import realism_in_words
from rvsg.evaluation.metrics.measurement import find_metric
from rvsg.evaluation.run_events import Contact, place_name
from rvsg.evaluation.story import Sentence, what_is_hit
from rvsg.evaluation.verdict import (
    OPEN,
    Status,
    Verdict,
    counted,
    difference_in_words,
    metres,
    number,
    share_in_words,
    still_open,
    value_in_words,
    violated,
)
from rvsg.report.run_facts import INVOLVED_M, AttemptFacts, Cause, Pair, RunFacts, Why
from rvsg.report.summary import Summary
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Mission
from rvsg.simulation.run import Run


def quantity(requirement: Requirement) -> str:
    """Return the judged quantity in words, with the id of its metric."""
    if requirement.formula is not None:
        return "robustness of the formula"
    known = find_metric(requirement.metric)
    if known is None:
        return requirement.metric or "objective"
    title = known.title[:1].lower() + known.title[1:] if known.title[1:2].islower() else known.title
    return f"{title} ({requirement.metric})"


def direction(requirement: Requirement) -> str:
    """Return which values are worse, e.g. `lower is worse`."""
    return "lower is worse" if requirement.worse == "smaller" else "higher is worse"


def shown_at(t_s: float) -> str:
    """Return the tenth of a second at which the replay shows what happens at a time: the first that is not before."""
    return f"{math.ceil(10 * t_s - 1e-6) / 10:.1f}"


def untimed(sentence: Sentence) -> str:
    """Return the text of a sentence without its time, which stands beside it."""
    text = sentence.text.removeprefix(f"At {sentence.time_s:.1f} s ").removeprefix(f"From {sentence.time_s:.1f} s on ")
    return text[:1].upper() + text[1:]


def robot_words(mission: Mission) -> str:
    """Return the robot's name and whether it is calibrated; the name alone where only another simulator knows it."""
    robot = mission.robot_record
    if robot is None:
        return mission.robot_name
    return f"{robot.name} ({'' if robot.calibrated else 'not '}calibrated against published runs)"


@dataclass(frozen=True)
class UnderTest:
    """The stack under test in the runs of a campaign."""

    repeatable: bool
    """Whether equal seeds give equal runs."""
    rows: tuple[tuple[str, str], ...]
    """What there is to tell, each with its label."""


def under_test(runs: Iterable[Run]) -> UnderTest:
    """Return what the runs tell of their people and their stack; of the built-in stack only what went wrong."""
    made = {run.id: run for run in runs}.values()  # attempts share runs
    told = [(run, facts) for run in made if isinstance(facts := run.details.get("stack"), Mapping)]
    kept, runs = [facts for _, facts in told], [run for run, _ in told]
    rows = (*_people(made), *_start(runs), *_pace(kept), *_trouble(kept, runs))
    return UnderTest(all(facts.get("repeatable", True) for facts in kept), rows)


def _people(runs: Iterable[Run]) -> Iterable[tuple[str, str]]:
    """Yield the profile of the people of the embedded simulator; what 0.2 stored as `default` is `hunavsim` today."""
    found = set()
    for options in (run.options for run in runs if run.simulator == "embedded"):
        old = "published-study" if options.get("profile") == "published-study" else "hunavsim"
        found.add("default profile" if options.get("human_model") == "anticipation" else old)
    if found:
        yield "People", ", ".join(sorted(found))


def _start(runs: list[Run]) -> Iterable[tuple[str, str]]:
    for name, label in (("launch", "Launch command"), ("params", "Parameter file")):
        given = {str(value) for run in runs if (value := _options(run).get(name))}
        if given:
            yield label, ", ".join(sorted(given))


def _options(run: Run) -> Mapping[str, Any]:
    stack = run.options.get("stack")
    options = stack.get("options") if isinstance(stack, Mapping) else None
    return options if isinstance(options, Mapping) else {}


def _pace(told: list[Mapping[str, Any]]) -> Iterable[tuple[str, str]]:
    """Yield how fast the runs went, and how many control periods were missed."""
    releases = sorted({str(facts["release"]) for facts in told if "release" in facts})
    if releases:
        yield "ROS 2", ", ".join(releases)
    kept = [facts for facts in told if "speed" in facts and "speed_asked" in facts]
    if kept:
        asked = _range([float(facts["speed_asked"]) for facts in kept], "g")
        reached = _range([float(facts["speed"]) for facts in kept], ".2f")
        yield "Speed, in times of real time", f"{asked} asked, {reached} reached"
    counts = [(facts["missed_periods"], facts["missed_periods"] + facts["commands"]) for facts in kept]
    due = sum(every for _, every in counts)
    if due:
        missed, worst = sum(some for some, _ in counts), max(some / every for some, every in counts if every)
        most = f" ({100.0 * missed / due:.2g} %), at most {100.0 * worst:.2g} % in one run" if missed else ""
        yield "Control periods missed", f"{missed:,} of {due:,}{most}"


def _trouble(told: list[Mapping[str, Any]], runs: list[Run]) -> Iterable[tuple[str, str]]:
    """Yield the velocities that the robot could not take as they came, and the first warnings of the stack."""
    for name, label in (
        ("clipped", "Velocities beyond the limits of the robot, cut"),
        ("not_finite", "Velocities that are no numbers, left out"),
    ):
        found = [facts[name] for facts in told if facts.get(name)]
        if found:
            yield label, f"{sum(found):,} in {counted(len(found), 'run')}"
    warned = [run for run in runs if run.stack_warnings]
    if warned:
        first = list(dict.fromkeys(text for run in warned for text in run.stack_warnings))[:3]
        yield "Runs with warnings of the stack", f"{len(warned)} of {len(runs)}; for instance: {'; '.join(first)}"


def _range(values: list[float], form: str) -> str:
    low, high = format(min(values), form), format(max(values), form)
    return low if low == high else f"{low} to {high}"


class Piece(NamedTuple):
    """A part of a sentence. With `runs` it is a link that opens them; `t_s` is the time at which it does."""

    text: str
    runs: tuple[str, ...] = ()
    t_s: float | None = None

    @property
    def address(self) -> str:
        """The part of the page's address that opens the runs in the replay."""
        if len(self.runs) == 1:
            return f"#run={self.runs[0]}" + (f"&t={shown_at(self.t_s)}" if self.t_s is not None else "")
        return "#runs=" + ",".join(self.runs)


Pieces = list[Piece]


def of_runs(text: str, runs: Iterable[RunFacts]) -> Piece:
    """Return a text that opens runs."""
    return Piece(text, ids_of(runs))


def said(text: str, **values: Piece | str) -> Pieces:
    """Return a sentence: a text in which each `{name}` stands for a value."""
    pieces: Pieces = []
    plain = ""
    for literal, name, _, _ in Formatter().parse(text):
        value = values[name] if name else ""
        plain += literal
        if isinstance(value, str):
            plain += value
        else:
            pieces += [*([Piece(plain)] if plain else []), value]
            plain = ""
    return [*pieces, Piece(plain)] if plain else pieces


@dataclass(frozen=True, kw_only=True)
class Badge:
    """A fact in two or three words beside the verdict. `tone` is bad, good, warn or quiet."""

    tone: str
    text: str
    runs: tuple[str, ...] = ()


def span_of(times: Sequence[float]) -> str:
    """Return between which times after the start something happens, in words."""
    low, high = min(times), max(times)
    when = f"{low:.0f} s" if round(low) == round(high) else f"{low:.0f} to {high:.0f} s"
    return f"{when} after the start"


def ids_of(runs: Iterable[RunFacts]) -> tuple[str, ...]:
    """Return the ids of runs."""
    return tuple(run.id for run in runs)


def seen_beside(
    runs: Sequence[RunFacts], plan: Plan, kind: str, nobody: Pair | None = None
) -> tuple[list[Badge], list[Pieces]]:
    """Return what the runs show besides the requirement: contacts, arrivals and the smallest gap.

    Args:
        nobody: The same seeds without people.
    """
    badges, sentences = [], []
    total = counted(len(runs), kind)
    touched = [run for run in runs if run.contacts]
    near = [(run.closest_m, run) for run in runs if run.closest_m is not None]
    if touched:
        badges.append(Badge(tone="bad", text=f"contact in {len(touched)} of {len(runs)} runs", runs=ids_of(touched)))
        sentences.append(_contacts(touched, total))
    elif near:
        badges.append(Badge(tone="good", text=f"no contact in {counted(len(runs), 'run')}"))
    struck = [run for run in runs if run.obstacle_contacts]
    if struck:
        hit = f"hits {_what_is_hit(struck)} in {len(struck)} of {len(runs)}"
        badges.append(Badge(tone="bad", text=hit, runs=ids_of(struck)))
        sentences.append(_struck(struck, total, nobody))
    late = [run for run in runs if not run.arrived]
    if late:
        badges.append(Badge(tone="bad", text=f"{len(late)} of {len(runs)} did not arrive", runs=ids_of(late)))
        sentences.append(
            said(
                "The robot does not reach its goal in {often} (time limit {limit}).",
                often=of_runs(f"{len(late)} of {total}", late),
                limit=number(plan.mission.route.time_limit_s, "s"),
            )
        )
    else:
        badges.append(Badge(tone="good", text="all arrived"))
    if near and not touched:
        gap, run = min(near, key=lambda each: each[0])
        sentences.append(
            said(
                "The robot touches nobody; the smallest gap is {gap}, to {who} near {place}, {when}.",
                gap=Piece(metres(gap), (run.id,), run.closest_s),
                who=run.closest_to,
                place=run.closest_near,
                when=span_of([run.closest_s]),
            )
        )
    return badges, sentences


def _contacts(touched: Sequence[RunFacts], total: str) -> Pieces:
    """Return in which runs robot and person touch, whom most often, where, for how long at most, and how fast."""

    def worst(metric: str, unit: str, otherwise: Callable[[Contact], float]) -> Piece:
        """Return the largest value, by the metric that the terminal reports, too."""
        pairs = [
            (otherwise(each) if (value := run.measurement.values.get(metric)) is None else value, run)
            for run in touched
            for each in run.contacts
        ]
        value, run = max(pairs, key=lambda pair: pair[0])
        return Piece(number(value, unit), (run.id,), run.contacts[0].time_s)

    first = [(run, run.contacts[0]) for run in touched]
    who, count = Counter(contact.person for _, contact in first).most_common(1)[0]
    theirs = [(run, contact) for run, contact in first if contact.person == who]
    near = Counter(place_name(run.world, contact.place.x, contact.place.y) for run, contact in theirs)
    return said(
        "Robot and person touch in {often} ({who}, near {place}, {when}); the longest contact lasts {longest}, and the "
        "largest relative speed is {fastest}.",
        often=of_runs(f"{len(touched)} of {total}", touched),
        who=who if count == len(touched) else f"{who} in {count}",
        place=near.most_common(1)[0][0],
        when=span_of([contact.time_s for _, contact in theirs]),
        longest=worst("contact_longest", "s", lambda each: each.duration_s),
        fastest=worst("contact_speed", "m/s", lambda each: each.closing_speed_m_s),
    )


def _struck(runs: Sequence[RunFacts], total: str, nobody: Pair | None) -> Pieces:
    """Return in which runs the robot hits an obstacle, where, how fast, and whether it does so without people."""
    first = [run.obstacle_contacts[0] for run in runs]
    near = Counter(place_name(run.world, e.place.x, e.place.y) for run, e in zip(runs, first, strict=True))
    hits = ((event, run) for run in runs for event in run.obstacle_contacts)
    hardest, in_hardest = max(hits, key=lambda pair: pair[0].speed_m_s)
    alone = [run for run in nobody.runs if run.obstacle_contacts] if nobody is not None else []
    without = "" if nobody is None else "; on the same seeds without people in {alone}"
    return said(
        f"The robot hits {{what}} in {{often}}, first near {{place}}, {{when}}; at most at {{speed}}{without}.",
        what=_what_is_hit(runs),
        often=of_runs(f"{len(runs)} of {total}", runs),
        place=near.most_common(1)[0][0],
        when=span_of([event.time_s for event in first]),
        speed=Piece(number(hardest.speed_m_s, "m/s"), (in_hardest.id,), hardest.time_s),
        alone=of_runs(f"{len(alone)} of {counted(len(nobody.runs), 'run')}", alone or nobody.runs) if nobody else "",
    )


def _what_is_hit(runs: Sequence[RunFacts]) -> str:
    """Return what the robot hits in any of the runs: a door by its name where it is that alone."""
    hit = {what_is_hit(event) for run in runs for event in run.obstacle_contacts}
    return hit.pop() if len(hit) == 1 else "an obstacle"


def elsewhere(others: Sequence[AttemptFacts], searched: Sequence[AttemptFacts]) -> list[Pieces]:
    """Return in how many runs that are not of the finding robot and person touch, if they do in any."""
    sentence: Pieces = []
    for attempts, kind, which in (
        (others, "confirmation run", " of other configurations"),
        (searched, "run", " of the search"),
    ):
        runs = distinct_runs(attempts)
        touched = [run for run in runs if run.contacts]
        if touched:
            begins = " and in " if sentence else "Elsewhere in the campaign, robot and person touch in "
            often = of_runs(f"{len(touched)} of {counted(len(runs), kind)}", touched)
            sentence += said(f"{begins}{{often}}{which}", often=often)
    return [[*sentence, Piece(".")]] if sentence else []


def distinct_runs(attempts: Iterable[AttemptFacts]) -> list[RunFacts]:
    """Return every run of some attempts once."""
    return list({run.id: run for attempt in attempts for run in attempt.runs}.values())


@dataclass(frozen=True, kw_only=True)
class Answer:
    """The top of the page."""

    tone: str
    chip: str
    text: str
    badges: list[Badge] = field(default_factory=list)
    sentences: list[Pieces] = field(default_factory=list)


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
        text = f"{name} has no limit. The worst scenario measures {value_in_words(confirmed, plan.requirement.unit)}."
        return {"tone": "quiet", "chip": "no limit", "text": text}
    runs = counted(confirmed.runs, "confirmation run")
    text = f"The worst scenario violates {name} in {confirmed.violations or 'none'} of {runs}"
    text += f"; {OPEN} (INCONCLUSIVE)." if still_open(confirmed) else "."
    return {"tone": tone_of(confirmed), "chip": _chip(confirmed), "text": text}


def _chip(verdict: Verdict) -> str:
    return "violated" if still_open(verdict) else verdict.status.value


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
    where = _where(confirmed)
    recurs = cause is not None and cause.finding.about_people == "no"
    told = [*because, *where] if recurs else [*where, *because]  # who is near matters less where nobody is needed
    seen += [*_realism(confirmed), *elsewhere(others, searched)]
    sentences = [*_judged(plan, confirmed, "confirmation run"), *told, *seen]
    return Answer(**top, badges=[*why, *badges], sentences=sentences)


def answer_of_runs(plan: Plan, facts: AttemptFacts) -> Answer:
    """Return the top of the page of runs that belong to no campaign."""
    verdict, requirement = facts.attempt.verdict, plan.requirement
    assert verdict is not None
    badges, seen = seen_beside(facts.runs, plan, "run")
    sentences = [*_judged(plan, facts, "run"), *_where(facts), *seen, *_realism(facts)]
    if verdict.status is Status.UNJUDGED:
        text = f"{requirement.name} has no limit. The runs measure {value_in_words(verdict, requirement.unit)}."
        return Answer(tone="quiet", chip="no limit", text=text, badges=badges, sentences=sentences)
    if verdict.runs == 1:
        text = f"The run {'violates' if verdict.violations else 'does not violate'} {requirement.name}"
    else:
        verb = "violates" if verdict.violations == 1 else "violate"
        text = f"{verdict.violations or 'None'} of {counted(verdict.runs, 'run')} {verb} {requirement.name}"
    text += f"; {OPEN} ({verdict.status.value})." if still_open(verdict) else "."
    return Answer(tone=tone_of(verdict), chip=_chip(verdict), text=text, badges=badges, sentences=sentences)


def _realism(facts: AttemptFacts) -> list[Pieces]:
    """Return whether anybody does what few recorded people did; the sentence opens the run and the moment."""
    if (found := facts.rarest_motion) is None:
        return []
    run, motion = found
    return [[Piece(realism_in_words(found), (run.id,) if motion.is_rare else (), motion.time_s)]]


def _judged(plan: Plan, facts: AttemptFacts, kind: str) -> list[Pieces]:
    """Return how often the limit is violated, and by how much."""
    verdict, requirement = facts.attempt.verdict, plan.requirement
    if verdict is None or verdict.mean is None:
        return []
    limit, unit = requirement.threshold, requirement.unit
    name = quantity(requirement)
    worst = facts.worst(requirement)
    single = worst is not None and worst.arrived and worst.measurement.objective is not None
    text = (
        "{quantity}: beyond the time limit in {late}; {median}"
        if verdict.censored
        else "{quantity}: {mean} on average over the runs"
    )
    text += " ({direction}{limit})." + (" The worst run measures {worst}." if single else "")
    measured = said(
        text,
        quantity=name[:1].upper() + name[1:],
        late=of_runs(f"{verdict.censored} of {counted(verdict.runs, 'run')}", facts.not_arrived),
        median=f"the median is {number(verdict.median, unit)}" if verdict.median is not None else "so is the median",
        mean=of_runs(number(verdict.mean, unit), facts.runs),
        direction=direction(requirement),
        limit=f"; the limit is {number(limit, unit)}" if limit is not None else "",
        worst=Piece(number(worst.measurement.objective, unit), (worst.id,), worst.decisive_s) if worst else "",
    )
    share = share_in_words(verdict)
    if not share:
        return [measured]
    bad = facts.violating
    often = of_runs(f"{len(bad)} of {counted(len(facts.runs), kind)}", bad or facts.runs)
    return [said("{name} is violated in {often}: {share}.", name=requirement.name, often=often, share=share), measured]


DECIDES: dict[Why, str] = {
    "limit": "The limit is first passed",
    "worst": "The worst value is reached",
    "time": "The robot loses most time",
    "share": "The momentary value is worst",
    "closest": "Robot and people are closest",
}


def _where(facts: AttemptFacts) -> list[Pieces]:
    """Return where and when the violating runs are decided, or all of them, and who is near then."""
    runs = facts.violating or facts.runs
    if not runs:
        return []
    why = Counter(run.decisive_why for run in runs).most_common(1)[0][0]
    if why == "closest" and not any(run.run.human_names for run in runs):
        return []
    told = [run for run in runs if run.decisive_why == why]
    many = "" if len(told) == len(runs) else f" in {len(told)} of {counted(len(runs), 'run')}"
    when = span_of([run.decisive_s for run in told])
    who = Counter(run.decisive_with for run in told if run.decisive_with).most_common(1)
    far = [run for run in told if not run.decisive_with]
    text = "{decides}{many} near {places}, {when}"
    if who:
        text += "; the nearest person then is {who}" + ("; in {far} nobody is within {reach}" if far else "")
    elif any(run.run.human_names for run in told):
        text += "; nobody is within {reach} of the robot then"
    name, count = who[0] if who else ("", 0)
    return [
        said(
            text + ".",
            decides=DECIDES[why],
            many=many,
            places=_near(told),
            when=when,
            who=of_runs(
                f"{name} in {count} of {counted(len(told), 'run')}", [r for r in told if r.decisive_with == name]
            ),
            far=of_runs(str(len(far)), far),
            reach=f"{INVOLVED_M:g} m",
        )
    ]


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


def _why(plan: Plan, cause: Cause) -> tuple[list[Badge], list[Pieces]]:
    """Return whether it was the people: the same seeds without them, and without each of them."""
    finding, nobody = cause.finding, cause.nobody
    difference, interval = finding.difference, finding.difference_interval
    if finding.about_people == "not violated":
        return [], []
    tone, badge, caused = CAUSED[finding.about_people]
    if finding.also_alone:
        caused = "It also happens without people, and these runs do not show whether people make it happen more often."
    if nobody is None or difference is None or interval is None:
        return [Badge(tone=tone, text=badge)], [said("{caused}", caused=caused)]
    if all(run.measurement.objective is None for run in nobody.runs):
        text = "Without people, {name} measures nothing: it is about the people themselves."
    else:
        text = "{caused} On the same seeds without people, the robot violates {name} in {alone} ({difference})."
    sentence = said(
        text,
        caused=caused,
        name=plan.requirement.name,
        alone=of_runs(
            f"{len(nobody.violating)} of {counted(len(nobody.runs), 'run')}", nobody.violating or nobody.runs
        ),
        difference=difference_in_words(difference, interval, finding.verdict.confidence),
    )
    for pair in cause.each:
        sentence += said(
            " Without {who} it is violated in {often} (with everybody in {before}).",
            who=pair.without,
            often=of_runs(f"{len(pair.violating)} of {counted(len(pair.runs), 'run')}", pair.runs),
            before=str(sum(run.violated for run in pair.before)),
        )
    return [Badge(tone=tone, text=badge, runs=ids_of(nobody.runs))], [sentence]
