"""VlmGenerator: a conversation with a vision language model turns a Brief into a Proposal.

Two conversations, one generator. `compact` (the default) asks for a whole configuration in one structured answer:
one call, and one more for each round of corrections. `study` follows the published method turn by turn: P1 or P2,
P3, P4, P6, P7 for a new scenario, P5, P6, P7 for each refinement, on one growing history. An unguided brief runs
through the same code with requirement, feedback and memory left out.

Our checker judges, not the model: findings go back at most `corrections` times, what is left is repaired, and what
cannot be repaired is a Proposal with problems.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from pydantic import ValidationError

from rvsg.core.errors import BudgetSpent, InputError, StoreError
from rvsg.core.records import canonical_json
from rvsg.generation.descriptions import Described, described_scenario
from rvsg.generation.environment import description_of
from rvsg.generation.facts import (
    answer_object,
    brief_facts,
    configuration_object,
    human_names,
    offered,
    passes_of,
    pictures_of,
    rehearsal_facts,
    small_map_of,
    world_facts,
)
from rvsg.generation.generator import Generator, Proposal, Rehearsal, Rehearse, surprises
from rvsg.generation.people_sampler import added, placed
from rvsg.generation.prompts import Dialogue, Prompts, number
from rvsg.generation.replies import Reply, read_configuration, read_description, read_path_lines
from rvsg.generation.reply_json import configuration_schema
from rvsg.generation.vlm.access import Access, Tell, wired
from rvsg.generation.vlm.model import Answer, Message, Model, Picture
from rvsg.generation.vlm.recording import MEASURED, place_of
from rvsg.scenario.brief import Brief
from rvsg.scenario.repair import repair
from rvsg.scenario.rules import Finding, Repair, read_ends
from rvsg.scenario.scenario import HumanConfiguration, Mission
from rvsg.scenario.validity import check
from rvsg.world.world import SolidObject, World

DRIVE = "drive"
"""The key of the drive without people in what a recording keeps of the measurements."""

TOLD = ("feedback", "memory", "untold", "lessons")
"""The fields of a brief that tell of runs that were made."""

Conversation = Literal["compact", "study"]


@dataclass(frozen=True, kw_only=True)
class _Judged:
    """An answer as the reader and the checker see it."""

    answer: Answer
    reply: Reply
    findings: tuple[Finding, ...]


class VlmGenerator(Generator):
    """Answers briefs by a conversation with a vision language model.

    `rehearse`, which the code that assembles a campaign may set, simulates a configuration before it is accepted: what
    does not happen as planned goes back at most `rehearsals` times. `provoking` offers the threatening behaviour.
    `model` is a model's name (`openai-chat:gpt-4.1`) or anything with `ask`; None where `replay` names a folder of
    recorded calls. `folder` is the campaign's: calls are recorded in `folder/vlm`, and templates in `folder/prompts`
    stand in for the shipped ones. The other options are those of `wiring.Access`.
    """

    def __init__(
        self,
        model: str | Model | None = None,
        *,
        conversation: Conversation = "compact",
        corrections: int = 2,
        rehearsals: int = 1,
        provoking: bool = False,
        folder: str | Path | None = None,
        prompts: str | Path | None = None,
        **access: Any,
    ) -> None:
        if conversation not in ("compact", "study"):
            raise InputError(
                f'There is no conversation "{conversation}". Choose compact or study.', code="conversation"
            )
        if not 0 <= corrections <= 10:
            raise InputError(
                f"The rounds of corrections must be between 0 and 10, got {corrections}.", code="corrections"
            )
        if not 0 <= rehearsals <= 10:
            raise InputError(f"The rehearsals must be between 0 and 10, got {rehearsals}.")
        self.conversation = conversation
        self.rehearsals = rehearsals
        self.provoking = provoking
        self.rehearse: Rehearse | None = None
        self._undisturbed: dict[str, Rehearsal] = {}
        self.corrections = corrections
        beside = Path(folder) / "prompts" if folder else None
        self.prompts = Prompts(prompts if prompts is not None else beside if beside and beside.is_dir() else None)
        self.wiring = wired(model, Access.of(access, record=Path(folder) / "vlm" if folder else None))
        self._histories: dict[str, tuple[Message, ...]] = {}
        self._moved = 0

    @property
    def name(self) -> str:
        """`vlm`."""
        return "vlm"

    @property
    def asks_a_model(self) -> bool:
        """True."""
        return True

    @property
    def notes(self) -> tuple[str, ...]:
        """Return where a replay diverged from its record."""
        if not self._moved:
            return self.wiring.notes()
        answers = "1 recorded answer was" if self._moved == 1 else f"{self._moved} recorded answers were"
        moved = f"Replay: {answers} given to other measured values or people than today's; the prompts tell those."
        return (*self.wiring.notes(), moved)

    def watch(self, tell: Tell | None) -> None:
        """Tell of every call while it is made; None ends it. A replay makes no calls."""
        if not self.wiring.replaying:
            self.wiring.model.tell = tell

    def allow_rehearsals(self, rehearse: Rehearse) -> None:
        """Simulate configurations with `rehearse` before they are accepted."""
        self.rehearse = rehearse

    def propose(self, brief: Brief, world: World) -> Proposal:
        """Answer the brief; raises ModelUnavailable, BudgetSpent or ReplayDiverged where there is no answer."""
        brief = self._as_recorded(brief)
        dialogue = self.opening(brief, world)
        if self.conversation == "compact":
            judged, description = self._compact(dialogue, brief, world)
        else:
            judged, description = self._study(dialogue, brief, world)
        proposal = self._concluded(dialogue, brief, world, judged, description)
        if proposal.scenario is not None and self.conversation == "study":
            self._keep_history(proposal.scenario.id, dialogue.messages)
        return proposal

    def _as_recorded(self, brief: Brief) -> Brief:
        """The brief as it is put to the model: in a replay with what was measured when it was recorded.

        The recorded answers are answers to that. What the simulator measures may change with every improvement of it;
        what is asked about a measured value should not. `notes` tell where the values differ.
        """
        recording = self.wiring.recording
        if recording is None:
            return brief
        if not self.wiring.replaying:
            drive = self._undisturbed_drive(brief)
            known = {DRIVE: drive.model_dump(mode="json")} if drive is not None else {}
            if _is_told(brief):
                known |= _measured(brief)
            if known:
                recording.keep_measured(session_of(brief), known)
            return brief
        if not _is_told(brief):
            return brief
        measured = recording.measured(session_of(brief))
        try:
            told = {k: v for k, v in measured.items() if k in TOLD} if isinstance(measured, dict) else None
            then = brief.model_validate(brief.model_dump(exclude=set(TOLD)) | told) if told else None
        except ValidationError:
            file = recording.folder / MEASURED
            raise StoreError(f"{file}: the measurements of {session_of(brief)} are damaged.") from None
        if then is None or (then.feedback is None) != (brief.feedback is None):
            return brief
        self._moved += _told_values(brief) != _told_values(then)
        return then

    def opening(self, brief: Brief, world: World) -> Dialogue:
        """The dialogue before the first question: what every call of the campaign has in common."""
        drive = self._undisturbed_drive(brief)
        facts = world_facts(world, description_of(world))
        facts |= brief_facts(brief, world, provoking=self.provoking, undisturbed=drive)
        route, way = brief.mission.route, drive.way if drive else ()
        small = self.conversation == "compact" and brief.feedback is not None
        pictures = (small_map_of(world, route, way),) if small else pictures_of(world, route, way)
        dialogue = Dialogue(self.wiring.model, self.prompts, session_of(brief), facts, pictures=pictures)
        if self.conversation == "study":
            history = self._history(brief)
            if history is not None:
                dialogue.messages = list(history)
                return dialogue
        dialogue.tell("system", role="system")
        if self.conversation == "compact":
            dialogue.tell("compact-context", shown=pictures, stable=True)
        return dialogue

    def _undisturbed_drive(self, brief: Brief) -> Rehearsal | None:
        """The drive without people, simulated once per mission; None without a simulator to ask.

        In a replay it is the one that was recorded, like everything measured.
        """
        mission, recording = brief.mission, self.wiring.recording
        if self.wiring.replaying and recording is not None:
            measured = recording.measured(session_of(brief))
            known = measured.get(DRIVE) if isinstance(measured, dict) else None
            try:
                return Rehearsal.model_validate(known) if known is not None else None
            except ValidationError:
                file = recording.folder / MEASURED
                raise StoreError(f"{file}: the drive of {session_of(brief)} is damaged.") from None
        if self.rehearse is None:
            return None
        if mission.id not in self._undisturbed:
            self._undisturbed[mission.id] = self.rehearse(mission, HumanConfiguration(humans=()))
        return self._undisturbed[mission.id]

    def first_prompts(self, brief: Brief, world: World) -> tuple[Message, ...]:
        """The messages of the first call for a brief, without making it."""
        dialogue = self.opening(brief, world)
        if self.conversation == "compact":
            self._before_compact(dialogue, brief)
            template = "compact-refine" if brief.feedback else "compact-new"
        elif brief.feedback is not None:
            self._before_refinement(dialogue, brief, world)
            template = "P5-refinement"
        else:
            template = _first_of_study(brief)
        shown = dialogue.pictures.values() if template.startswith(("P1", "P2")) else ()
        dialogue.tell(template, shown=shown)
        return tuple(dialogue.messages)

    def pictures(self, brief: Brief, world: World) -> tuple[Picture, ...]:
        """The pictures that the calls for a brief show."""
        return tuple(self.opening(brief, world).pictures.values())

    # -- compact -----------------------------------------------------------------------------------------------------

    def _compact(self, dialogue: Dialogue, brief: Brief, world: World) -> tuple[list[_Judged], str]:
        """One structured answer, and corrections while there is something to correct."""
        self._before_compact(dialogue, brief)
        shape = configuration_schema(rich=True, behaviours=offered(self.provoking), actors=world.actors)
        purpose, template = ("refine", "compact-refine") if brief.feedback else ("new", "compact-new")
        judged = [self._judge(dialogue.ask(purpose, template, shape=shape), brief, world)]
        while judged[-1].findings and len(judged) <= self.corrections:
            answer = self._ask_again(dialogue, judged[-1], "compact-correction", "correct", shape)
            judged.append(self._judge(answer, brief, world))
        self._rehearsed(dialogue, judged, brief, world)
        return judged, _described(judged)

    def _rehearsed(self, dialogue: Dialogue, judged: list[_Judged], brief: Brief, world: World) -> None:
        """Rehearse a valid answer, and ask for a better one where something does not happen as planned.

        In a replay the recorded answer after the rehearsal is taken, where there is one: what a rehearsal shows may
        change with every improvement of the simulator, the recorded answers do not.
        """
        for _ in range(self.rehearsals):
            people = judged[-1].reply.people
            if judged[-1].findings or people is None:
                return
            rehearsal = Rehearsal(robot=(), arrival_s=None)
            found: tuple[str, ...] = ()
            if self.rehearse is not None:
                mission, _ = placed(brief.mission, world, _moved(judged[-1].reply, brief))
                rehearsal = self.rehearse(mission, people)
                found = surprises(rehearsal, judged[-1].reply.plan)
            if not (self._has_recorded_rehearsal(dialogue) if self.wiring.replaying else found):
                return
            try:
                answer = dialogue.ask(
                    "rehearse",
                    "compact-rehearsal",
                    shape=configuration_schema(rich=True, behaviours=offered(self.provoking), actors=world.actors),
                    surprises=list(found),
                    rehearsal=rehearsal_facts(rehearsal, passes_of(self._undisturbed_drive(brief), world.grid)),
                )
            except BudgetSpent:
                return  # the valid answer is paid for, and stands
            revised = self._judge(answer, brief, world)
            if revised.findings or revised.reply.people is None:
                return  # the valid answer before it stands
            judged.append(revised)

    def _has_recorded_rehearsal(self, dialogue: Dialogue) -> bool:
        """Return whether the next call of the dialogue was recorded as one about a rehearsal."""
        recording, number = self.wiring.recording, len(dialogue.calls) + 1
        ending = f"/{number:02d}-rehearse"
        place = place_of(dialogue.session)
        return recording is not None and any(
            call.key.endswith(ending) and place_of(call.session) == place for call in recording
        )

    def _before_compact(self, dialogue: Dialogue, brief: Brief) -> None:
        """A refinement answers on top of the configuration that was simulated, in the form answers have."""
        if brief.feedback is not None:
            dialogue.tell_text(
                "assistant",
                canonical_json(answer_object(brief.feedback, added(brief.mission, brief.feedback.scenario.mission))),
            )

    def _ask_again(
        self, dialogue: Dialogue, last: _Judged, template: str, purpose: str, shape: dict[str, Any] | None
    ) -> Answer:
        """Send the findings back, or say that nothing could be read."""
        if last.reply.people is None:
            return dialogue.ask(purpose, "reply-unreadable", shape=shape, problem=_unreadable(last))
        return dialogue.ask(purpose, template, shape=shape, findings=[str(f) for f in last.findings])

    # -- study -------------------------------------------------------------------------------------------------------

    def _study(self, dialogue: Dialogue, brief: Brief, world: World) -> tuple[list[_Judged], str]:
        """The published sequence of prompts; the checker's findings go into P6.

        It ends where an answer is refused or empty: what follows would be paid for and lead nowhere.
        """
        description = ""
        if brief.feedback is not None:
            self._before_refinement(dialogue, brief, world)
            paths = dialogue.ask("P5", "P5-refinement")
        else:
            template = _first_of_study(brief)
            paths = dialogue.ask(template[:2], template, shown=dialogue.pictures.values())
            description = read_description(paths.text) or " ".join(paths.text.split())[-1500:]
            for purpose, step in (("P3", "P3-tasks"), ("P4", "P4-paths")):
                paths = dialogue.ask(purpose, step) if _of_use(paths) else paths
        if not _of_use(paths):
            return [self._judge(paths, brief, world)], description
        judged: list[_Judged] = []
        findings = self._findings_of_lines(paths.text, human_names(brief.humans), brief, world)
        while not judged or (judged[-1].findings and len(judged) <= self.corrections):
            if judged and judged[-1].reply.people is None:
                answer = dialogue.ask("P7", "reply-unreadable", problem=_unreadable(judged[-1]))
                judged.append(self._judge(answer, brief, world))
                continue
            left = judged[-1].findings if judged else findings
            revised = dialogue.ask("P6", "P6-revision", findings=[str(finding) for finding in left])
            judged.append(
                self._configuration(dialogue, brief, world) if _of_use(revised) else self._judge(revised, brief, world)
            )
        return judged, description or _described(judged)

    def _configuration(self, dialogue: Dialogue, brief: Brief, world: World) -> _Judged:
        # A refinement describes itself; a new scenario was described in step 1.
        shape = configuration_schema(rich=False, described=brief.feedback is not None)
        answer = dialogue.ask("P7", "P7-configuration", shape=shape)
        return self._judge(answer, brief, world)

    def _findings_of_lines(self, text: str, names: Sequence[str], brief: Brief, world: World) -> tuple[Finding, ...]:
        """What the checker says of the paths in prose; one finding where the lines cannot be read."""
        people = read_path_lines(text, names)
        if people is None:
            reason = f"the lines `human | task | waypoints` for {', '.join(names)} could not be found in your answer."
            return (Finding(rule="unreadable-reply", reason=reason, suggestion="Give them in exactly that form."),)
        return check(read_ends(people, world), brief.mission, world)

    def _before_refinement(self, dialogue: Dialogue, brief: Brief, world: World) -> None:
        """Return the shortest history that says the same, where that of the scenario is not known any more."""
        if brief.feedback is None or len(dialogue.messages) > 1:
            return
        last = brief.feedback.scenario
        dialogue.tell("P1-scenario", shown=dialogue.pictures.values())
        dialogue.tell_text("assistant", canonical_json({"scenario": last.description}))
        dialogue.tell("P4-paths")
        dialogue.tell_text("assistant", canonical_json(configuration_object(last.people, rich=False)))

    def _history(self, brief: Brief) -> tuple[Message, ...] | None:
        if brief.feedback is None:
            return None
        scenario_id = brief.feedback.scenario.id
        if scenario_id in self._histories:
            return self._histories[scenario_id]
        recording = self.wiring.recording
        return recording.history(scenario_id) if recording is not None else None

    def _keep_history(self, scenario_id: str, messages: Iterable[Message]) -> None:
        history = tuple(messages)
        self._histories[scenario_id] = history
        if self.wiring.recording is not None and not self.wiring.replaying:
            self.wiring.recording.keep_history(scenario_id, history)

    # -- judging -----------------------------------------------------------------------------------------------------

    def _judge(self, answer: Answer, brief: Brief, world: World) -> _Judged:
        """What the reader and the checker find in an answer."""
        if not _of_use(answer):
            reason = "the model refused to answer." if answer.finish == "refused" else "the answer is empty."
            finding = Finding(rule=f"{answer.finish}-reply", reason=reason)
            return _Judged(answer=answer, reply=Reply(findings=(finding,), fatal=True), findings=(finding,))
        reply = read_configuration(
            answer.text, human_names(brief.humans), actors=world.actors, lidar_height_m=world.lidar_height_m
        )
        if reply.people is None:
            return _Judged(answer=answer, reply=reply, findings=reply.findings)
        people = read_ends(reply.people, world)
        mission, place = placed(brief.mission, world, _moved(reply, brief))
        reply, checked = replace(reply, people=people), check(people, mission, place)
        return _Judged(answer=answer, reply=reply, findings=(*reply.findings, *checked))

    def _concluded(
        self, dialogue: Dialogue, brief: Brief, world: World, judged: Sequence[_Judged], description: str
    ) -> Proposal:
        """The proposal: the last answer that can be used, repaired where it must be."""
        usable = [j for j in judged if j.reply.people is not None and not j.reply.fatal]
        last = usable[-1] if usable else judged[-1]
        people, repairs, problems = last.reply.people, last.reply.repairs, last.findings
        if usable and people is not None:
            mission, place = placed(brief.mission, world, _moved(last.reply, brief))
            people, repairs, problems = self._repaired(people, last, mission, place)
        valid = people if usable and not problems else None
        scenario = None
        if valid is not None:
            described = Described(description) if description else None
            scenario = described_scenario(brief, valid, described, _moved(last.reply, brief))
        return Proposal(
            generator=self.name,
            scenario=scenario,
            reasoning=last.reply.analysis,
            lesson=last.reply.lesson if _is_told(brief) else "",
            plan={name: dict(moments) for name, moments in last.reply.plan.items()},
            first_findings=judged[0].findings,
            problems=problems,
            repairs=repairs if valid else (),
            corrections=len(judged) - 1,
            calls=tuple(dialogue.calls),
            extra={
                "conversation": self.conversation,
                "pictures": [p.reference.model_dump(mode="json") for p in dialogue.pictures.values()],
                "findings_by_answer": [len(j.findings) for j in judged],
                "complete": last.reply.complete,
                "repaired_json": last.reply.repaired_json,
            },
        )

    def _repaired(
        self, people: HumanConfiguration, last: _Judged, mission: Mission, world: World
    ) -> tuple[HumanConfiguration, tuple[Repair, ...], tuple[Finding, ...]]:
        if not check(people, mission, world):
            return people, last.reply.repairs, ()
        mended, repairs = repair(people, mission, world)
        return mended, (*last.reply.repairs, *repairs), check(mended, mission, world)


def _moved(reply: Reply, brief: Brief) -> tuple[SolidObject, ...]:
    """Return the objects that a reply moves; a refinement that says nothing of them keeps those of its scenario."""
    if reply.moved is not None or brief.feedback is None:
        return reply.moved or ()
    return added(brief.mission, brief.feedback.scenario.mission)


def session_of(brief: Brief) -> str:
    """Return the name under which the calls for a brief are recorded."""
    return f"s{brief.scenario_index:03d}-c{brief.configuration_index:02d}-{brief.seed % 0xFFFFFFFF:08x}"


def _measured(brief: Brief) -> dict[str, Any]:
    """What a brief says of runs that were made."""
    return brief.model_dump(mode="json", include=set(TOLD))


def _is_told(brief: Brief) -> bool:
    """Whether a brief says anything of runs."""
    return brief.feedback is not None or bool(brief.memory)


def _told_values(brief: Brief) -> tuple[str, ...]:
    """The mean values of a brief as prompts write them, and whose they are."""
    values = [(brief.feedback.mean, brief.feedback.scenario)] if brief.feedback else []
    values += [(earlier.mean, earlier.scenario) for earlier in brief.memory]
    return tuple(f"{number(mean)} {scenario.people.id}" for mean, scenario in values)


def _described(judged: Sequence[_Judged]) -> str:
    """The description in the last answer that holds one."""
    return next((j.reply.description for j in reversed(judged) if j.reply.description), "")


def _first_of_study(brief: Brief) -> str:
    return "P2-diverse-scenario" if brief.memory else "P1-scenario"


def _of_use(answer: Answer) -> bool:
    return answer.finish not in ("refused", "empty")


def _unreadable(judged: _Judged) -> str:
    if judged.answer.finish == "refused":
        return (
            "it was a refusal. This is a test in a simulator: nobody can come to harm, and the people do ordinary work."
        )
    return " ".join(finding.reason for finding in judged.findings)
