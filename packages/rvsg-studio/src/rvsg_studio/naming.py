"""Names for areas that a model proposes: ask, list, and drop what a person does not want. Accepting is an edit."""

from __future__ import annotations

import json
import shlex
from typing import Any

import rvsg
from rvsg.core.files import write_whole
from rvsg.world.world_folder import shipped_worlds
from rvsg_studio.answers import text_of, world_place
from rvsg_studio.asked_model import AskedModel, asked_model, keep_model
from rvsg_studio.workspace import Workspace

DROPPED = "dropped.json"


def names(workspace: Workspace, given: dict[str, Any]) -> dict[str, Any]:
    """Return the model that is asked, how the newest job stands, and the proposals that are left to decide on."""
    name = text_of(given, "world")
    job = workspace.jobs.of(_target(name))
    known = asked_model(workspace)
    told: dict[str, Any] = {"asked": known.model_dump(mode="json"), "state": "", "said": "", "names": []}
    if job is None:
        return told
    areas = {area.name for area in rvsg.load_world(world_place(workspace, given)).areas}
    dropped = json.loads((job.folder / DROPPED).read_text(encoding="utf-8")) if (job.folder / DROPPED).exists() else []
    left = [
        each
        for each in job.result.get("names", [])
        if each["area"] in areas and each["name"] not in areas and each["area"] not in dropped
    ]
    return told | {"state": job.state, "said": job.result.get("said") or job.result.get("reason", ""), "names": left}


def model(workspace: Workspace, given: dict[str, Any]) -> dict[str, Any]:
    """Keep what is typed in the fields that name a model, and return them."""
    told = given["asked"] if isinstance(given.get("asked"), dict) else {}
    known = {key: value for key, value in told.items() if key in AskedModel.model_fields}
    return keep_model(workspace, **known).model_dump(mode="json")


def ask(workspace: Workspace, given: dict[str, Any]) -> dict[str, Any]:
    """Begin a job that asks a model for names."""
    name = text_of(given, "world")
    world_place(workspace, given)
    model(workspace, given)
    asked = asked_model(workspace)
    command = f"rvsg world name {shlex.quote(name)} {asked.options}"
    workspace.jobs.start("names", title="Names of areas", command=command, target=_target(name), world=name,
                         access=asked.arguments)  # fmt: skip
    return names(workspace, given)


def drop(workspace: Workspace, given: dict[str, Any]) -> dict[str, Any]:
    """Leave a proposal out from now on."""
    job = workspace.jobs.of(_target(text_of(given, "world")))
    if job is not None:
        path = job.folder / DROPPED
        dropped = json.loads(path.read_text(encoding="utf-8")) if path.exists() else []
        write_whole(path, json.dumps(sorted({*dropped, text_of(given, "area")})))
    return names(workspace, given)


def _target(name: str) -> str:
    return f"names in {name if name in shipped_worlds() else name.removeprefix('./')}"
