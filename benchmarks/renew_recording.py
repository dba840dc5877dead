"""Render the prompts of a shipped demonstration with today's templates, and keep its recorded answers.

    python benchmarks/renew_recording.py warehouse-route_1-R1
    python benchmarks/renew_recording.py describe-warehouse

For changes of the prompts after which the recorded answers still answer the question. The measurements that a
refinement is told, the drive without people and what a rehearsal said stay those of the recording. Where a question has
changed, record again with a model instead (`benchmarks/ship_recording.py` says how).
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from typing import Literal

from rvsg.core.documents import read_yaml
from rvsg.evaluation.signals import aim_of, moved_by
from rvsg.generation.conversation import DRIVE, CompactConversation, Conversation, VlmGenerator, session_of
from rvsg.generation.environment import EnvironmentDialogue
from rvsg.generation.generator import Rehearsal
from rvsg.generation.prompts import Prompts
from rvsg.generation.replies import Reply
from rvsg.generation.reply_json import configuration_schema
from rvsg.generation.vlm.access import ModelAccess
from rvsg.generation.vlm.call_log import CALLS, CallLog, Replayed, place_of
from rvsg.scenario.brief import Brief
from rvsg.scenario.requirement import load_requirement
from rvsg.scenario.scenario import HumanConfiguration, Mission
from rvsg.world.world import World
from rvsg.world.world_folder import load_world
from ship_recording import folder_of, ship


def briefs(name: str, world: World) -> list[Brief]:
    """The briefs of a recorded campaign, with what was measured then."""
    config = read_yaml(folder_of(name) / "campaign.yaml").value
    route = world.route(config["route"])
    recording = CallLog(folder_of(name))
    found = []
    requirement = load_requirement(config["requirement"]).for_time_limit(route.time_limit_s)
    for session in dict.fromkeys(call.session for call in recording):
        scenario, configuration = (int(part[1:]) for part in place_of(session).split("-"))
        told = {k: v for k, v in recording.measured(session).items() if k != DRIVE}
        brief = {
            "mission": Mission(world="warehouse", world_id=world.id, route=route),
            "requirement": requirement,
            "aim": aim_of(requirement),
            "moved_by": moved_by(requirement),
            "kind": "refine" if told.get("feedback") else "new",
            "humans": config.get("humans", 2),
            "seed": int(session.split("-")[2], 16),
            "scenario_index": scenario,
            "configuration_index": configuration,
        }
        found.append(Brief.model_validate(brief | told))
    return found


class Renewing(VlmGenerator):
    """Asks recorded answers with today's prompts, and knows only the measurements of the recording."""

    def __init__(self, old: CallLog, folder: Path, conversation: Literal["compact", "study"]) -> None:
        super().__init__(Replayed(old), conversation=conversation, folder=folder)
        self.old = old

    def open(self, brief: Brief, world: World) -> Conversation:
        """Take what rehearsals told from the recording."""
        return Renewed(self, brief, world) if self.conversation == "compact" else super().open(brief, world)

    def undisturbed_drive(self, brief: Brief) -> Rehearsal | None:
        """Return the drive of the recording."""
        drive = self.old.measured(session_of(brief)).get(DRIVE)
        return Rehearsal.model_validate(drive) if drive else None


class Renewed(CompactConversation):
    """Takes what a rehearsal told from the recording."""

    generator: Renewing

    def _rehearsed(self, reply: Reply, people: HumanConfiguration) -> Reply | None:
        dialogue, old = self.dialogue, self.generator.old
        key = f"{dialogue.session}/{len(dialogue.calls) + 1:02d}-rehearse"
        call = next((call for call in old if call.key == key), None)
        if call is None:
            return None
        dialogue.tell_text("user", old.message(call.messages[-1]).text)
        return self._read(dialogue.answered("rehearse", configuration_schema(rich=True)))


def renew(name: str, folder: Path) -> None:
    """Ask the recorded answers with today's prompts, and record that in a folder."""
    world, old = load_world("warehouse"), Replayed(CallLog(folder_of(name)))
    if not (folder_of(name) / "campaign.yaml").exists():
        EnvironmentDialogue(world, ModelAccess(old, recording=CallLog(folder)), Prompts()).describe()
        return
    config = read_yaml(folder_of(name) / "campaign.yaml").value
    generator = Renewing(CallLog(folder_of(name)), folder, config["conversation"])
    for brief in briefs(name, world):
        generator.propose(brief, world)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("name", help="the demonstration")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        renew(given.name, Path(folder))
        ship(next(Path(folder).rglob(CALLS)).parent, given.name)
