"""Conversation with a vision language model that turns a Brief into a Proposal, and VlmGenerator, which holds it.

`compact` (the default) asks for a whole configuration in one structured answer. `study` follows the published method
turn by turn: P1 or P2, P3, P4, P6, P7 for a new scenario, P5, P6, P7 for each refinement, on one growing history.
Our checker judges, not the model: findings go back at most `corrections` times, what is left is repaired.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

from pydantic import ValidationError

from rvsg.core.errors import BudgetSpent, InputError, StoreError
from rvsg.core.records import canonical_json
from rvsg.generation.descriptions import Described, described_scenario
from rvsg.generation.environment import description_of
from rvsg.generation.facts import brief_facts, human_names, offered, pictures_of, told_facts, world_facts
from rvsg.generation.generator import Generator, Proposal, Rehearsal, Rehearse, surprises
from rvsg.generation.people_sampler import added, placed
from rvsg.generation.prompts import Dialogue, Prompts, number
from rvsg.generation.replies import Reply, read_configuration, read_description, read_path_lines
from rvsg.generation.reply_json import configuration_schema
from rvsg.generation.result_facts import MOST_ROWS, answer_object, configuration_object, passes_of, rehearsal_facts
from rvsg.generation.vlm.access import Tell, model_access
from rvsg.generation.vlm.call_log import MEASURED, place_of
from rvsg.generation.vlm.model import Access, Answer, Message, Model, Picture
from rvsg.scenario.brief import Brief
from rvsg.scenario.repair import repair
from rvsg.scenario.rules import Finding, Repair, read_ends
from rvsg.scenario.scenario import HumanConfiguration, Scenario
from rvsg.scenario.validity import check
from rvsg.world.world import SolidObject, World

DRIVE = "drive"
"""The key of the drive without people in what a recording keeps of the measurements."""

TOLD = ("feedback", "memory", "untold", "lessons")
"""The fields of a brief that tell of runs that were made."""

MOST_WORDS = 3000
"""A request of the compact conversation has at most so many words, as far as fewer lines of its tables help."""
ROWS, REHEARSED_ROWS = (MOST_ROWS, 12, 10, 9, 7, 5, 4, 3), 10
"""Lines of a table of runs, fewer and fewer, and of that of a rehearsal."""
CONTEXT = 2
"""The messages that every request of a campaign begins with."""


class VlmGenerator(Generator):
    """Answers briefs by a conversation with a vision language model.

    `rehearse`, which the code that assembles a campaign may set, simulates a configuration before it is accepted: what
    does not happen as planned goes back at most `rehearsals` times. `provoking` offers the threatening behaviour.
    `model` is a model's name (`openai-chat:gpt-4.1`) or anything with `ask`; None where `replay` names a folder of
    recorded calls. `folder` is the campaign's: calls are recorded in `folder/vlm`, and templates in `folder/prompts`
    stand in for the shipped ones. The other options are those of `Access`.
    """

    name = "vlm"
    asks_a_model = True
    code_options = ()

    def __init__(
        self,
        model: str | Model | None = None,
        *,
        conversation: Literal["compact", "study"] = "compact",
        corrections: int = 2,
        rehearsals: int = 1,
        provoking: bool = False,
        folder: str | Path | None = None,
        prompts: str | Path | None = None,
        **access: Any,
    ) -> None:
        if conversation not in CONVERSATIONS:
            reason = f'There is no conversation "{conversation}". Choose compact or study.'
            raise InputError(reason, code="conversation")
        if not 0 <= corrections <= 10:
            reason = f"The rounds of corrections must be between 0 and 10, got {corrections}."
            raise InputError(reason, code="corrections")
        if not 0 <= rehearsals <= 10:
            raise InputError(f"The rehearsals must be between 0 and 10, got {rehearsals}.")
        self.conversation, self.corrections, self.rehearsals = conversation, corrections, rehearsals
        self.provoking = provoking
        self.rehearse: Rehearse | None = None
        beside = Path(folder) / "prompts" if folder else None
        self.prompts = Prompts(prompts if prompts is not None else beside if beside and beside.is_dir() else None)
        self.access = model_access(model, Access.of(access, record=Path(folder) / "vlm" if folder else None))
        self.histories: dict[str, tuple[Message, ...]] = {}
        self._undisturbed: dict[str, Rehearsal] = {}
        self._moved = 0

    @property
    def notes(self) -> tuple[str, ...]:
        """Return where a replay diverged from its record."""
        if not self._moved:
            return self.access.notes()
        answers = "1 recorded answer was" if self._moved == 1 else f"{self._moved} recorded answers were"
        moved = f"Replay: {answers} given to other measured values or people than today's; the prompts tell those."
        return (*self.access.notes(), moved)

    def watch(self, tell: Tell | None) -> None:
        """Tell of every call while it is made; None ends it. A replay makes no calls."""
        if not self.access.replaying:
            self.access.tell = tell

    def allow_rehearsals(self, rehearse: Rehearse) -> None:
        """Simulate configurations with `rehearse` before they are accepted."""
        self.rehearse = rehearse

    def propose(self, brief: Brief, world: World) -> Proposal:
        """Answer the brief; raises ModelUnavailable, BudgetSpent or ReplayDiverged where there is no answer."""
        conversation = self.open(self._as_recorded(brief), world)
        conversation.hold()
        proposal = conversation.concluded()
        if proposal.scenario is not None and self.conversation == "study":
            self.histories[proposal.scenario.id] = tuple(conversation.dialogue.messages)
            if self.access.recording is not None and not self.access.replaying:
                self.access.recording.keep_history(proposal.scenario.id, conversation.dialogue.messages)
        return proposal

    def open(self, brief: Brief, world: World) -> Conversation:
        """The conversation about a brief before its first question: what every call of the campaign has in common."""
        return CONVERSATIONS[self.conversation](self, brief, world)

    def first_prompts(self, brief: Brief, world: World) -> tuple[Message, ...]:
        """The messages of the first call for a brief, without making it."""
        conversation = self.open(brief, world)
        template, shown = conversation.first_question()
        conversation.dialogue.tell(template, shown=shown)
        return tuple(conversation.dialogue.messages)

    def pictures(self, brief: Brief, world: World) -> tuple[Picture, ...]:
        """The pictures that the calls for a brief show."""
        return tuple(self.open(brief, world).dialogue.pictures.values())

    def undisturbed_drive(self, brief: Brief) -> Rehearsal | None:
        """The drive without people, simulated once per mission or as recorded; None without a simulator to ask."""
        mission, recording = brief.mission, self.access.recording
        if self.access.replaying and recording is not None:
            known = recording.measured(session_of(brief)).get(DRIVE)
            try:
                return Rehearsal.model_validate(known) if known is not None else None
            except ValidationError:
                raise self._damaged(f"the drive of {session_of(brief)} is") from None
        if self.rehearse is None:
            return None
        if mission.id not in self._undisturbed:
            self._undisturbed[mission.id] = self.rehearse(mission, HumanConfiguration(humans=()))
        return self._undisturbed[mission.id]

    def _as_recorded(self, brief: Brief) -> Brief:
        """Return the brief, in a replay with what was measured when it was recorded; `notes` tell the differences."""
        recording, session = self.access.recording, session_of(brief)
        if recording is None:
            return brief
        if not self.access.replaying:
            drive = self.undisturbed_drive(brief)
            known = {DRIVE: drive.model_dump(mode="json")} if drive is not None else {}
            if _is_told(brief):
                known |= brief.model_dump(mode="json", include=set(TOLD))
            if known:
                recording.keep_measured(session, known)
            return brief
        told = {key: value for key, value in recording.measured(session).items() if key in TOLD}
        if not told or not _is_told(brief):
            return brief
        try:
            then = brief.model_validate(brief.model_dump(exclude=set(TOLD)) | told)
        except ValidationError:
            raise self._damaged(f"the measurements of {session} are") from None
        if (then.feedback is None) != (brief.feedback is None):
            return brief
        self._moved += _told_values(brief) != _told_values(then)
        return then

    def _damaged(self, what: str) -> StoreError:
        assert self.access.recording is not None
        return StoreError(f"{self.access.recording.folder / MEASURED}: {what} damaged.")


class Conversation(ABC):
    """A conversation about one brief, with all answers as the reader and the checker see them."""

    def __init__(self, generator: VlmGenerator, brief: Brief, world: World) -> None:
        self.generator, self.brief, self.world = generator, brief, world
        self.drive = generator.undisturbed_drive(brief)
        facts = world_facts(world, description_of(world))
        facts |= brief_facts(brief, world, provoking=generator.provoking, undisturbed=self.drive)
        pictures = pictures_of(world, brief.mission.route, self.drive.way if self.drive else ())
        self.dialogue = Dialogue(generator.access, generator.prompts, session_of(brief), facts, pictures)
        self.replies: list[Reply] = []
        self.rehearsals: list[tuple[Scenario, float]] = []
        self.description = ""
        """That of the scenario, where an answer before the configuration gives it."""

    @abstractmethod
    def first_question(self) -> tuple[str, tuple[Picture, ...]]:
        """Say what comes before the first question; return its template and the pictures it shows."""

    @abstractmethod
    def hold(self) -> None:
        """Ask until there is a valid configuration, or no round of corrections is left."""

    def _read(self, answer: Answer) -> Reply:
        """What the reader and the checker find in an answer."""
        if not _of_use(answer):
            reason = "the model refused to answer." if answer.finish == "refused" else "the answer is empty."
            return Reply(findings=(Finding.of(f"{answer.finish}-reply", reason),), fatal=True)
        names, world = human_names(self.brief.humans), self.world
        reply = read_configuration(answer.text, names, actors=world.actors, lidar_height_m=world.lidar_height_m)
        if reply.people is None:
            return reply
        people = read_ends(reply.people, world)
        mission, place = placed(self.brief.mission, world, self._moved(reply))
        return replace(reply, people=people, findings=(*reply.findings, *check(people, mission, place)))

    def _moved(self, reply: Reply) -> tuple[SolidObject, ...]:
        """Return the objects that a reply moves; a refinement that says nothing of them keeps those of its scenario."""
        if reply.moved is not None or self.brief.feedback is None:
            return reply.moved or ()
        return added(self.brief.mission, self.brief.feedback.scenario.mission)

    def concluded(self) -> Proposal:
        """The proposal: the last answer that can be used, repaired where it must be."""
        usable = [reply for reply in self.replies if reply.people is not None and not reply.fatal]
        last = usable[-1] if usable else self.replies[-1]
        scenario, problems, repairs = None, last.findings, tuple[Repair, ...]()
        if usable and last.people is not None:
            mission, place = placed(self.brief.mission, self.world, self._moved(last))
            people, changes = repair(last.people, mission, place)
            problems = check(people, mission, place)
            if not problems:
                text = self.description or next((r.description for r in reversed(self.replies) if r.description), "")
                described = Described(text) if text else None
                scenario = described_scenario(self.brief, people, described, self._moved(last))
                repairs = (*last.repairs, *changes)
        return Proposal(
            generator=self.generator.name,
            scenario=scenario,
            reasoning=last.analysis,
            lesson=last.lesson if _is_told(self.brief) else "",
            plan={name: dict(moments) for name, moments in last.plan.items()},
            limits=last.limits,
            first_findings=self.replies[0].findings,
            problems=problems,
            repairs=repairs,
            corrections=len(self.replies) - 1,
            calls=tuple(self.dialogue.calls),
            rehearsals=tuple(self.rehearsals),
            extra={
                "conversation": self.generator.conversation,
                "pictures": [p.reference.model_dump(mode="json") for p in self.dialogue.pictures.values()],
                "findings_by_answer": [len(reply.findings) for reply in self.replies],
                "complete": last.complete,
                "repaired_json": last.repaired_json,
            },
        )


class CompactConversation(Conversation):
    """One structured answer, and corrections while there is something to correct."""

    def __init__(self, generator: VlmGenerator, brief: Brief, world: World) -> None:
        super().__init__(generator, brief, world)
        behaviours = offered(generator.provoking)
        self.shape = configuration_schema(rich=True, behaviours=behaviours, actors=world.actors, tunes=brief.tunes)
        self.dialogue.tell("system", role="system")
        self.dialogue.tell("compact-context", shown=self.dialogue.pictures.values(), stable=True)

    def first_question(self) -> tuple[str, tuple[Picture, ...]]:
        """A refinement answers on top of the configuration that was simulated, in the form answers have."""
        feedback = self.brief.feedback
        if feedback is not None:
            moved = added(self.brief.mission, feedback.scenario.mission)
            self.dialogue.tell_text("assistant", canonical_json(answer_object(feedback, moved)))
        template = "compact-new" if feedback is None else "compact-refine"
        for rows in ROWS:
            self.dialogue.facts |= told_facts(self.brief, self.world, self.drive, rows)
            if self.dialogue.words(template) <= MOST_WORDS:
                break
        return template, ()

    def _ask_again(self, purpose: str, template: str, **more: Any) -> Reply:
        """Ask about the last answer; where the request gets too long, without the question before it."""
        if self.dialogue.words(template, **more) > MOST_WORDS:
            del self.dialogue.messages[CONTEXT:-1]
        return self._read(self.dialogue.ask(purpose, template, shape=self.shape, **more))

    def hold(self) -> None:
        """Ask, correct, and rehearse."""
        template, _ = self.first_question()
        self.replies = [self._read(self.dialogue.ask(template.removeprefix("compact-"), template, shape=self.shape))]
        while (last := self.replies[-1]).findings and len(self.replies) <= self.generator.corrections:
            if last.people is None:
                self.replies.append(self._ask_again("correct", "reply-unreadable", problem=_unreadable(last)))
            else:
                findings = [str(finding) for finding in last.findings]
                self.replies.append(self._ask_again("correct", "compact-correction", findings=findings))
        for _ in range(self.generator.rehearsals):
            last = self.replies[-1]
            revised = self._rehearsed(last, last.people) if last.people is not None and not last.findings else None
            if revised is None or revised.findings or revised.people is None:
                return  # the valid answer before it stands
            self.replies.append(revised)

    def _rehearsed(self, reply: Reply, people: HumanConfiguration) -> Reply | None:
        """Rehearse a valid answer, and ask for a better one where something does not happen as planned; else None.

        In a replay the recorded answer after the rehearsal is taken, where there is one.
        """
        access, dialogue = self.generator.access, self.dialogue
        rehearsal, found = Rehearsal(robot=(), arrival_s=None), tuple[str, ...]()
        if self.generator.rehearse is not None:
            mission, _ = placed(self.brief.mission, self.world, self._moved(reply))
            rehearsal = self.generator.rehearse(mission, people)
            found = surprises(rehearsal, reply.plan)
            if rehearsal.value is not None:
                self.rehearsals.append((Scenario(mission=mission, people=people), rehearsal.value))
        wanted = bool(found) and not rehearsal.capped
        if access.replaying:
            place, ending = place_of(dialogue.session), f"/{len(dialogue.calls) + 1:02d}-rehearse"
            calls = access.recording or ()
            wanted = any(call.key.endswith(ending) and place_of(call.session) == place for call in calls)
        if not wanted:
            return None
        told = rehearsal_facts(
            rehearsal, passes_of(self.drive, self.world.grid), self.brief.requirement, REHEARSED_ROWS
        )
        try:
            return self._ask_again("rehearse", "compact-rehearsal", surprises=list(found), rehearsal=told)
        except BudgetSpent:
            return None  # the valid answer is paid for, and stands


class StudyConversation(Conversation):
    """The published sequence of prompts; the checker's findings go into P6."""

    def __init__(self, generator: VlmGenerator, brief: Brief, world: World) -> None:
        super().__init__(generator, brief, world)
        history, recording = None, generator.access.recording
        if brief.feedback is not None:
            refined = brief.feedback.scenario.id
            history = generator.histories.get(refined) or (
                recording.history(refined) if recording is not None else None
            )
        if history is not None:
            self.dialogue.messages = list(history)
        else:
            self.dialogue.tell("system", role="system")

    def first_question(self) -> tuple[str, tuple[Picture, ...]]:
        """A refinement without the history of its scenario gets the shortest one that says the same."""
        pictures = tuple(self.dialogue.pictures.values())
        if self.brief.feedback is None:
            return "P2-diverse-scenario" if self.brief.memory else "P1-scenario", pictures
        if len(self.dialogue.messages) == 1:
            last = self.brief.feedback.scenario
            self.dialogue.tell("P1-scenario", shown=pictures)
            self.dialogue.tell_text("assistant", canonical_json({"scenario": last.description}))
            self.dialogue.tell("P4-paths")
            self.dialogue.tell_text("assistant", canonical_json(configuration_object(last.people, rich=False)))
        return "P5-refinement", ()

    def hold(self) -> None:
        """Ask turn by turn; end where an answer is refused or empty: what follows would be paid for in vain."""
        template, shown = self.first_question()
        paths = self.dialogue.ask(template[:2], template, shown=shown)
        if self.brief.feedback is None:
            self.description = read_description(paths.text) or " ".join(paths.text.split())[-1500:]
            for purpose, step in (("P3", "P3-tasks"), ("P4", "P4-paths")):
                paths = self.dialogue.ask(purpose, step) if _of_use(paths) else paths
        if not _of_use(paths):
            self.replies.append(self._read(paths))
            return
        findings = self._findings_of_lines(paths.text)
        while not self.replies or (findings and len(self.replies) <= self.generator.corrections):
            if self.replies and self.replies[-1].people is None:
                answer = self.dialogue.ask("P7", "reply-unreadable", problem=_unreadable(self.replies[-1]))
            else:
                answer = self.dialogue.ask("P6", "P6-revision", findings=[str(finding) for finding in findings])
                if _of_use(answer):
                    # A refinement describes itself; a new scenario was described in step 1.
                    shape = configuration_schema(rich=False, described=self.brief.feedback is not None)
                    answer = self.dialogue.ask("P7", "P7-configuration", shape=shape)
            self.replies.append(self._read(answer))
            findings = self.replies[-1].findings

    def _findings_of_lines(self, text: str) -> tuple[Finding, ...]:
        """What the checker says of the paths in prose; one finding where the lines cannot be read."""
        names = human_names(self.brief.humans)
        people = read_path_lines(text, names)
        if people is None:
            reason = f"the lines `human | task | waypoints` for {', '.join(names)} could not be found in your answer."
            return (Finding.of("unreadable-reply", reason, "Give them in exactly that form."),)
        return check(read_ends(people, self.world), self.brief.mission, self.world)


CONVERSATIONS = {"compact": CompactConversation, "study": StudyConversation}


def session_of(brief: Brief) -> str:
    """Return the name under which the calls for a brief are recorded."""
    return f"s{brief.scenario_index:03d}-c{brief.configuration_index:02d}-{brief.seed % 0xFFFFFFFF:08x}"


def _is_told(brief: Brief) -> bool:
    """Whether a brief says anything of runs."""
    return brief.feedback is not None or bool(brief.memory)


def _told_values(brief: Brief) -> tuple[str, ...]:
    """The mean values of a brief as prompts write them, and of which situations."""
    values = [(brief.feedback.mean, brief.feedback.scenario)] if brief.feedback else []
    values += [(earlier.mean, earlier.scenario) for earlier in brief.memory]
    return tuple(f"{number(mean)} {scenario.situation}" for mean, scenario in values)


def _of_use(answer: Answer) -> bool:
    return answer.finish not in ("refused", "empty")


def _unreadable(reply: Reply) -> str:
    if reply.findings[0].rule == "refused-reply":
        return (
            "it was a refusal. This is a test in a simulator: nobody can come to harm, and the people do ordinary work."
        )
    return " ".join(finding.reason for finding in reply.findings)
