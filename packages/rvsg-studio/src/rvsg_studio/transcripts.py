"""Transcripts of a campaign's conversations with a model, and what the checker said of the answers."""

from __future__ import annotations

from pathlib import Path

from rvsg.app.campaign import Campaign
from rvsg.core.errors import InputError
from rvsg.core.records import Record
from rvsg.generation.generator import Proposal
from rvsg.generation.vlm.recording import PICTURES, RecordedCall, Recording

LONGEST_DIGEST = 128


class Turn(Record):
    """One call of a model: what was new in what it was given, and what it answered."""

    key: str
    purpose: str
    model: str
    given: tuple[tuple[str, str], ...] = ()
    """Role and text of each message that the call before did not hold."""
    pictures: tuple[str, ...] = ()
    """The pictures shown in it that are kept, by digest."""
    lost_pictures: int = 0
    """Pictures shown in it that the record does not hold, as in recordings that ship with RVSG."""
    answer: str = ""
    error: str = ""
    input_tokens: int = 0
    output_tokens: int = 0
    cost_usd: float | None = None
    seconds: float = 0.0


class Conversation(Record):
    """How one configuration came to be."""

    attempt: int
    scenario: int
    configuration: int
    generator: str
    reasoning: str
    description: str
    valid: bool
    findings: tuple[str, ...]
    """What the checker said of the first answer."""
    problems: tuple[str, ...]
    """What was left at the end."""
    repairs: tuple[str, ...]
    corrections: int
    cost_usd: float | None
    calls: int
    turns: tuple[Turn, ...]
    """Empty where the calls were not recorded."""

    def holds(self, words: str) -> bool:
        """Return whether a text stands anywhere in it, in whatever case."""
        texts = [self.reasoning, self.description, *self.findings, *self.problems]
        texts += [text for turn in self.turns for text in (turn.answer, turn.error, *(t for _, t in turn.given))]
        return any(words.casefold() in text.casefold() for text in texts)


def conversations_of(campaign: Campaign) -> tuple[Conversation, ...]:
    """Return how each configuration of the search came to be, in order."""
    recording = recording_of(campaign)
    by_key = {} if recording is None else {call.key: call for call in recording}
    found = []
    for attempt in campaign.attempts():
        if attempt.purpose != "search":
            continue
        proposal, brief = attempt.proposal, attempt.brief
        costs = [call.cost_usd for call in proposal.calls]
        found.append(
            Conversation(
                attempt=attempt.index,
                scenario=brief.scenario_index,
                configuration=brief.configuration_index,
                generator=proposal.generator,
                reasoning=proposal.reasoning,
                description=proposal.scenario.description if proposal.scenario else "",
                valid=proposal.scenario is not None,
                findings=tuple(str(finding) for finding in proposal.first_findings),
                problems=tuple(str(finding) for finding in proposal.problems),
                repairs=tuple(f"{repair.human}, {repair.task}: {repair.what}" for repair in proposal.repairs),
                corrections=proposal.corrections,
                cost_usd=None if None in costs else sum(cost for cost in costs if cost is not None),
                calls=len(proposal.calls),
                turns=tuple(_turns(proposal, by_key, recording)),
            )
        )
    return tuple(found)


def recording_of(campaign: Campaign) -> Recording | None:
    """Return the record of a campaign's calls: beside it, or the one it was replayed from; None if there is none."""
    replayed = campaign.config.replay
    for folder in (campaign.folder / "vlm", *([Path(replayed)] if replayed else [])):
        if (folder / "calls.jsonl").is_file():
            return Recording(folder)
    return None


def picture_of_call(campaign: Campaign, digest: str) -> bytes:
    """Return a picture that a model was shown, as PNG.

    Raises:
        InputError: there is none of that digest.
    """
    recording = recording_of(campaign)
    if recording is not None and digest.isalnum() and len(digest) <= LONGEST_DIGEST:
        path = _picture(recording, digest)
        if path.is_file():
            return path.read_bytes()
    raise InputError("This picture is not kept in the record of the campaign.")


def _picture(recording: Recording, digest: str) -> Path:
    return recording.folder / PICTURES / f"{digest}.png"


def _turns(proposal: Proposal, by_key: dict[str, RecordedCall], recording: Recording | None) -> list[Turn]:
    turns: list[Turn] = []
    known: set[str] = set()
    for call in proposal.calls:
        kept = by_key.get(call.recording or "")
        given, pictures = [], []
        if kept is not None and recording is not None:
            for identity in kept.messages:
                if identity not in known:
                    message = recording.message(identity)
                    given.append((message.role, message.text))
                    pictures += [picture.digest for picture in message.pictures]
            known.update(kept.messages)
        shown = tuple(dict.fromkeys(pictures))
        stored = tuple(each for each in shown if recording is not None and _picture(recording, each).is_file())
        turns.append(
            Turn(
                key=call.recording or "",
                purpose=call.purpose,
                model=call.model,
                given=tuple(given),
                pictures=stored,
                lost_pictures=len(shown) - len(stored),
                answer=kept.answer.text if kept is not None and kept.answer is not None else "",
                error=call.error or "",
                input_tokens=call.input_tokens,
                output_tokens=call.output_tokens,
                cost_usd=call.cost_usd,
                seconds=call.latency_s,
            )
        )
    return turns
