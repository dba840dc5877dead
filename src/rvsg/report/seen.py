"""Observations besides the requirement: contacts, obstacles that are hit, arrivals and the smallest gap."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence

from rvsg.campaign.attempt import Plan
from rvsg.evaluation.naming import place_name
from rvsg.evaluation.story import what_is_hit
from rvsg.evaluation.wording import counted, number
from rvsg.report.causes import Pair
from rvsg.report.facts import AttemptFacts, RunFacts
from rvsg.report.pieces import Badge, Piece, Sentence, ids_of, span_of
from rvsg.report.words import metres


def seen_beside(
    runs: Sequence[RunFacts], plan: Plan, kind: str, nobody: Pair | None = None
) -> tuple[list[Badge], list[Sentence]]:
    """Return what the runs show besides the requirement: contacts, arrivals and the smallest gap.

    Args:
        nobody: The same seeds without people.
    """
    badges, sentences = [], []
    total = counted(len(runs), kind)
    touched = [run for run in runs if run.contacts]
    people = any(run.closest_m is not None for run in runs)
    if touched:
        badges.append(Badge(tone="bad", text=f"contact in {len(touched)} of {len(runs)} runs", runs=ids_of(touched)))
        sentences.append(_contacts(touched, total))
    elif people:
        badges.append(Badge(tone="good", text=f"no contact in {counted(len(runs), 'run')}"))
    struck = [run for run in runs if run.obstacle_contacts]
    if struck:
        hit = f"hits {_what_is_hit(struck)} in {len(struck)} of {len(runs)}"
        badges.append(Badge(tone="bad", text=hit, runs=ids_of(struck)))
        sentences.append(_struck(struck, total, nobody))
    late = [run for run in runs if not run.arrived]
    if late:
        badges.append(Badge(tone="bad", text=f"{len(late)} of {len(runs)} did not arrive", runs=ids_of(late)))
        limit = number(plan.mission.route.time_limit_s, "s")
        sentences.append(
            [
                Piece("The robot does not reach its goal in "),
                Piece(f"{len(late)} of {total}", ids_of(late)),
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
                Piece(f", to {nearest.closest_to} near {nearest.closest_near}, {span_of([nearest.closest_s])}."),
            ]
        )
    return badges, sentences


def _contacts(touched: Sequence[RunFacts], total: str) -> Sentence:
    """Return in which runs robot and person touch, for how long at most, and how fast."""
    longest, in_longest = max(
        ((_measured(run, "contact_longest", c.duration_s), run) for run in touched for c in run.contacts),
        key=lambda pair: pair[0],
    )
    fastest, in_fastest = max(
        ((_measured(run, "contact_speed", c.closing_speed_m_s), run) for run in touched for c in run.contacts),
        key=lambda pair: pair[0],
    )
    return [
        Piece("Robot and person touch in "),
        Piece(f"{len(touched)} of {total}", ids_of(touched)),
        Piece(f" ({_touched(touched)}); the longest contact lasts "),
        Piece(number(longest, "s"), (in_longest.id,), in_longest.contacts[0].time_s),
        Piece(", and the largest relative speed is "),
        Piece(number(fastest, "m/s"), (in_fastest.id,), in_fastest.contacts[0].time_s),
        Piece("."),
    ]


def _struck(runs: Sequence[RunFacts], total: str, nobody: Pair | None) -> Sentence:
    """Return in which runs the robot hits an obstacle, where, how fast, and whether it does so without people."""
    first = [run.obstacle_contacts[0] for run in runs]
    near = Counter(place_name(run.world, e.place.x, e.place.y) for run, e in zip(runs, first, strict=True))
    hits = ((event, run) for run in runs for event in run.obstacle_contacts)
    hardest, in_hardest = max(hits, key=lambda pair: pair[0].speed_m_s)
    sentence = [
        Piece(f"The robot hits {_what_is_hit(runs)} in "),
        Piece(f"{len(runs)} of {total}", ids_of(runs)),
        Piece(f", first near {near.most_common(1)[0][0]}, {span_of([event.time_s for event in first])}; at most at "),
        Piece(number(hardest.speed_m_s, "m/s"), (in_hardest.id,), hardest.time_s),
    ]
    if nobody is not None:
        alone = [run for run in nobody.runs if run.obstacle_contacts]
        said = f"{len(alone)} of {counted(len(nobody.runs), 'run')}"
        sentence += [Piece("; on the same seeds without people in "), Piece(said, ids_of(alone or nobody.runs))]
    return [*sentence, Piece(".")]


def _what_is_hit(runs: Sequence[RunFacts]) -> str:
    """Return what the robot hits in any of the runs: a door by its name where it is that alone."""
    hit = {what_is_hit(event) for run in runs for event in run.obstacle_contacts}
    return hit.pop() if len(hit) == 1 else "an obstacle"


def _touched(runs: Sequence[RunFacts]) -> str:
    """Return whom the robot touches most often, where, and when, in words."""
    first = [run.contacts[0] for run in runs]
    who, count = Counter(contact.person for contact in first).most_common(1)[0]
    theirs = [(run, contact) for run, contact in zip(runs, first, strict=True) if contact.person == who]
    near = Counter(place_name(run.world, contact.place.x, contact.place.y) for run, contact in theirs)
    often = "" if count == len(runs) else f" in {count}"
    return f"{who}{often}, near {near.most_common(1)[0][0]}, {span_of([contact.time_s for _, contact in theirs])}"


def elsewhere(others: Sequence[AttemptFacts], searched: Sequence[AttemptFacts]) -> list[Sentence]:
    """Return in how many runs that are not of the finding robot and person touch, if they do in any."""
    sentence: Sentence = []
    for attempts, kind, which in (
        (others, "confirmation run", " of other configurations"),
        (searched, "run", " of the search"),
    ):
        runs = distinct_runs(attempts)
        touched = [run for run in runs if run.contacts]
        if touched:
            sentence += [
                Piece(" and in " if sentence else "Elsewhere in the campaign, robot and person touch in "),
                Piece(f"{len(touched)} of {counted(len(runs), kind)}", ids_of(touched)),
                Piece(which),
            ]
    return [[*sentence, Piece(".")]] if sentence else []


def _measured(run: RunFacts, metric: str, otherwise: float) -> float:
    """Return the metric of a run, which the terminal and the JSON report, too."""
    value = run.measurement.values.get(metric)
    return otherwise if value is None else value


def distinct_runs(attempts: Iterable[AttemptFacts]) -> list[RunFacts]:
    """Return every run of some attempts once."""
    return list({run.id: run for attempt in attempts for run in attempt.runs}.values())
