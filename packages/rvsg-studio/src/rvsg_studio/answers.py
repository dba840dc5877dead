"""The data behind the pages: each address answers with JSON or a listed file, by a function of workspace and question.

The JavaScript components fetch and send it.
"""

from __future__ import annotations

import json
import shlex
import threading
from collections.abc import Callable
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import Any
from urllib.parse import quote

from fastapi import FastAPI, Request
from fastapi.responses import JSONResponse, Response
from nicegui import run

import rvsg
from rvsg import Scenario, Spec, World
from rvsg.app.comparison import VersionComparison, compare_versions
from rvsg.app.playback import kept_trace, trace_source
from rvsg.app.saved_scenario import rerun
from rvsg.core import permission
from rvsg.core.documents import read_record
from rvsg.core.errors import InputError, RvsgError
from rvsg.core.files import write_whole
from rvsg.evaluation.verdict import counted, load_requirement
from rvsg.generation.environment import ProposedDoor, ProposedLabel
from rvsg.report.renderer import component, look
from rvsg.report.replay_data import distinct_colours
from rvsg.report.stills import area_colours, frame, look_of
from rvsg.robots.robot import shipped_robots
from rvsg.scenario.builder import check_valid, load_scenario_in, save_scenario
from rvsg.scenario.requirement import Requirement, shipped_requirements
from rvsg.scenario.world_lookup import world_of
from rvsg.search.run_set import RunSet
from rvsg.simulation.route_trial import SimulatedTrial, trial_of
from rvsg.simulation.simulators import as_found
from rvsg.simulation.stacks.stack_choice import stack_names
from rvsg.tune.tuner import PAGE, RESULT
from rvsg.tune.tuning import Tuning
from rvsg.world.creation import other_robot
from rvsg.world.drawing.svg import floor_plan
from rvsg.world.edits import begin_doors
from rvsg.world.routes import fitted
from rvsg.world.world_folder import shipped_worlds
from rvsg_studio.model_questions import AskedModel, asked_model, keep_model, picture_of_call
from rvsg_studio.question import Question, number_of, question_of, text_of
from rvsg_studio.scenario_editor import (
    BEHAVIOURS,
    empty_scenario,
    floor_of,
    related,
    replay_of_attempts,
    replay_of_runs,
    scenario_of,
    simulated,
    try_out,
    with_person,
)
from rvsg_studio.workspace import (
    BOTH,
    LARGEST_FILE,
    Workspace,
    forget,
    listed,
    read_json,
    receiver,
    typed,
    typed_keep,
)
from rvsg_studio.world_editor import History, editable_world, remarks_on

Answer = Callable[[Workspace, Question], Any]


def replay(workspace: Workspace, question: Question) -> dict[str, Any]:
    """Return the replay of an attempt of a campaign, and of what is tied to it unless it is asked for `alone`."""
    folder, name = workspace.existing(text_of(question, "campaign")), question.name
    index, alone = number_of(question, "attempt"), bool(question.alone)

    def compute() -> dict[str, Any]:
        campaign = campaign_of(workspace, question)
        shown = related(campaign.attempts(), index)
        return replay_of_attempts(campaign, shown[:1] if alone else shown)

    return workspace.cached(("replay", str(folder), name, index, alone), folder, compute)


def campaign_of(workspace: Workspace, question: Question) -> rvsg.Campaign:
    """Return the campaign of a question."""
    return rvsg.Campaign.open(workspace.existing(text_of(question, "campaign")), question.name or None)


def world_place(workspace: Workspace, question: Question) -> str | Path:
    """Return the world that is meant: the name of a shipped one, or a folder in the workspace."""
    name = text_of(question, "world")
    return name if name in shipped_worlds() else workspace.existing(name)


def world(workspace: Workspace, question: Question) -> dict[str, Any]:
    """Return what the editor of a world shows."""
    place = world_place(workspace, question)
    done, undone = history_of(workspace, question).steps
    drivers = {"robots": [*shipped_robots()], "stacks": stack_names()}
    return editable_world(place) | {"undo": done, "redo": undone} | drivers


def world_check(workspace: Workspace, question: Question) -> list[dict[str, Any]]:
    """Return what the check finds in a world."""
    trial = trial_asked(workspace, question) if question.drive else None
    return remarks_on(world_place(workspace, question), trial=trial, robot=trial.robot if trial else None)


def trial_asked(workspace: Workspace, question: Question) -> SimulatedTrial:
    """Return a trial with the robot and the stack of a question: each a name, or a file in the workspace."""
    names, asked = ("", *shipped_robots(), *stack_names()), (question.robot, question.stack)
    robot, stack = (name if name in names else workspace.existing(name) for name in asked)
    return trial_of(other_robot(robot or None), stack or None)


def world_edit(workspace: Workspace, question: Question) -> dict[str, Any]:
    """Make a change in a world and return the world as it is then."""
    if (change := question.change) is None:
        raise InputError("The request has no change.")
    with _editing:
        if change.get("what") == "add door":
            begin_doors(world_place(workspace, question))
        history_of(workspace, question).make(world_place(workspace, question), change, together=question.together or "")
    return world(workspace, question)


def _world_step(step: Callable[[History], None]) -> Answer:
    """Return the answer that undoes or makes again the last change of a world."""

    def answer(workspace: Workspace, question: Question) -> dict[str, Any]:
        with _editing:
            step(history_of(workspace, question))
        return world(workspace, question)

    return answer


def world_drive(workspace: Workspace, question: Question) -> dict[str, Any]:
    """Drive a route with nobody about and return how it went."""
    loaded = rvsg.load_world(world_place(workspace, question))
    trial, route = trial_asked(workspace, question), loaded.route(text_of(question, "route"))
    fit = route if trial.robot is None else fitted(route, trial.robot, loaded)[0]
    return trial.drive(loaded, fit).model_dump(mode="json")


def history_of(workspace: Workspace, question: Question) -> History:
    """Return the changes of a world that can be undone."""
    return History(workspace.own_file("undo", str(world_place(workspace, question))))


def scenario(workspace: Workspace, question: Question) -> dict[str, Any]:
    """Return what the editor of a scenario shows: of an attempt, a case of a suite, a file, or a route of a world."""
    loaded, place, simulator = scenario_place(workspace, question)
    draft = draft_of(workspace, question)
    edited, own = read_json(draft, None), _own_requirement(workspace, question)
    shipped = shipped_requirements() | ({own.name: own} if own is not None else {})
    return {
        "scenario": edited or loaded.model_dump(mode="json"),
        "original": loaded.model_dump(mode="json"),
        "draft": edited is not None,
        "simulator": simulator.name,
        "floor": floor_of(place),
        "title": place.title,
        "waypoints": [[w.name, w.x, w.y] for w in place.grid.waypoints if w.human],
        "requirements": {name: requirement.title for name, requirement in shipped.items()},
        "behaviours": list(BEHAVIOURS),
        "colours": distinct_colours(MOST_COLOURS),
    }


def scenario_place(workspace: Workspace, question: Question) -> tuple[Scenario, World, Spec]:
    """Return the scenario a page is about, its world, and what simulates it."""
    if question.campaign:
        folder, name = workspace.existing(text_of(question, "campaign")), question.name
        index = number_of(question, "attempt")

        def compute() -> tuple[Scenario, World, Spec]:
            campaign = campaign_of(workspace, question)
            wanted = next((a.proposal.scenario for a in campaign.attempts() if a.index == index), None)
            if wanted is None:
                raise InputError(f"There is no attempt {index} with a scenario in this campaign.")
            return wanted, campaign.world, campaign.simulator

        return workspace.cached(("scenario", str(folder), name, index), folder, compute)
    if question.case:
        suite, case = rvsg.Suite.open(workspace.existing(text_of(question, "suite"))), text_of(question, "case")
        chosen = next((entry for entry in suite.cases if entry.name == case), None)
        if chosen is None:
            raise InputError(f"There is no case {case!r} in this suite.")
        simulator = as_found(chosen.simulator)
        assert isinstance(simulator, Spec)
        return chosen.scenario, suite.worlds[case], simulator
    if question.file:
        again = rerun(workspace.existing(text_of(question, "file")))
        return again.scenario, again.world, again.simulator
    place = rvsg.load_world(world_place(workspace, Question(world=question.world or "warehouse")))
    if not place.routes:
        raise InputError(f"{place.name} has no route yet. Draw one on its map first.")
    return empty_scenario(place, question.route or place.routes[0].name), place, Spec("embedded")


def scenario_try(workspace: Workspace, question: Question) -> dict[str, Any]:
    """Simulate the scenario as it stands in the editor."""
    wanted, place, simulator, requirement = _asked(workspace, question)
    if stops := question.stops:
        wanted = with_person(wanted, place, stops)
    seeds = range(min(MOST_SEEDS, max(1, number_of(question, "seeds"))))
    tried = try_out(wanted, place, requirement, seeds=seeds, simulator=simulator, as_is=bool(question.as_is))
    more = {"unit": requirement.unit, "limit": requirement.threshold, "requirement": requirement.name}
    return tried.model_dump(mode="json") | more


def scenario_keep(workspace: Workspace, question: Question) -> dict[str, Any]:
    """Keep the scenario of the editor as a draft until it is saved, where it differs from what was loaded."""
    wanted = _wanted(question)
    loaded, draft = scenario_place(workspace, question)[0], draft_of(workspace, question)
    with _editing:
        if wanted == loaded:
            draft.unlink(missing_ok=True)
        else:
            write_whole(draft, json.dumps(wanted.model_dump(mode="json")))
    return {}


def scenario_replay(workspace: Workspace, question: Question) -> dict[str, Any]:
    """Return the replay of the scenario as it stands in the editor, over several seeds."""
    wanted, place, simulator, requirement = _asked(workspace, question)
    return replay_of_runs(simulated(wanted, place, range(MOST_SEEDS), simulator), requirement)


def scenario_save(workspace: Workspace, question: Question) -> dict[str, Any]:
    """Save the scenario of the editor as a file, or as a case of a suite."""
    wanted, place, _, requirement = _asked(workspace, question)
    check_valid(wanted, place)
    if question.add_to:
        folder = workspace.path(text_of(question, "add_to"))
        suite = rvsg.Suite.create(folder).add(wanted, requirement.name, title=question.title or None, world=place)
        said = f"{workspace.relative(folder)} holds {counted(len(suite.cases), 'case')}."
    else:
        path = workspace.path(text_of(question, "save_as"))
        save_scenario(wanted, path)
        said = f"Saved as {workspace.relative(path)}."
    draft_of(workspace, question).unlink(missing_ok=True)
    return {"said": said}


def scenario_discard(workspace: Workspace, question: Question) -> dict[str, Any]:
    """Forget the changes that were not saved."""
    draft_of(workspace, question).unlink(missing_ok=True)
    return scenario(workspace, question)


def _asked(workspace: Workspace, question: Question) -> tuple[Scenario, World, Spec, Requirement]:
    _, place, simulator = scenario_place(workspace, question)
    wanted = _wanted(question)
    name, own = question.requirement or "R1", _own_requirement(workspace, question)
    requirement = own if own is not None and own.name == name else load_requirement(name, wanted.mission.route)
    return wanted, world_of(wanted.mission, place), simulator, requirement


def _own_requirement(workspace: Workspace, question: Question) -> Requirement | None:
    """Return the requirement of the campaign that a scenario is of."""
    return campaign_of(workspace, question).requirement if question.campaign else None


def _wanted(question: Question) -> Scenario:
    value = question.scenario
    if not isinstance(value, dict):
        raise InputError("The request has no scenario.")
    return scenario_of(value)


def draft_of(workspace: Workspace, question: Question) -> Path:
    """Return where changes of a scenario are kept until they are saved."""
    keys = ("campaign", "name", "attempt", "file", "world", "route", "suite", "case")
    return workspace.own_file("drafts", json.dumps([getattr(question, key) or "" for key in keys]))


def runs(workspace: Workspace, question: Question) -> dict[str, Any]:
    """Return the replay of a file of runs of a scenario."""
    file, scenario_file = (
        workspace.existing(text_of(question, "file")),
        workspace.existing(text_of(question, "scenario")),
    )

    def compute() -> dict[str, Any]:
        asked, place = load_scenario_in(scenario_file)
        requirement = load_requirement("R1", asked.mission.route)
        if question.campaign:
            requirement = rvsg.Campaign.open(workspace.existing(text_of(question, "campaign"))).requirement
        return replay_of_runs(RunSet(rvsg.load_runs(file).runs, asked, place), requirement)

    return workspace.cached(("runs", str(file), str(scenario_file)), file, compute)


def recording(workspace: Workspace, question: Question) -> Any:
    """Return the replay of a recorded drive and the nearest simulated one, of a job that has finished."""
    job = workspace.jobs.get(text_of(question, "job"))
    if (both := read_json(job.folder / BOTH, None)) is None:
        raise InputError(f"The job {job.id} made no scenario of a recording.")
    return both


def tuning_in(workspace: Workspace, folder: str) -> Tuning | None:
    """Return the tuning in a folder; None where there is none."""
    path = workspace.path(folder) / RESULT
    return read_record(path, Tuning) if path.is_file() else None


def tuning(workspace: Workspace, question: Question) -> Response:
    """Return the page of a tuning, a file of the folder: its scripts may not act on the studio."""
    path = workspace.existing(f"{text_of(question, 'folder')}/{PAGE}")
    headers = {"content-security-policy": "sandbox allow-scripts"}
    return Response(path.read_bytes(), media_type="text/html", headers=headers)


def tuned(workspace: Workspace, question: Question) -> Response:
    """Return the file that a tuning proposes, to be saved."""
    result = tuning_in(workspace, folder := text_of(question, "folder"))
    if result is None or result.file is None:
        raise InputError(f"{folder}: there is no proposal here.")
    path = workspace.existing(f"{folder}/{Path(result.file).name}")
    headers = {"content-disposition": f"attachment; filename*=UTF-8''{quote(path.name)}"}
    return Response(path.read_bytes(), media_type="application/octet-stream", headers=headers)


def versions(workspace: Workspace, question: Question) -> dict[str, Any]:
    """Return the replay of a case of a suite by two versions, run again on the first seed that differs."""
    compared = compared_versions(workspace, *(text_of(question, key) for key in ("first", "second", "suite")))
    return compared.replay(text_of(question, "case"), text_of(question, "requirement"))


def compared_versions(workspace: Workspace, first: str, second: str, suite: str = "") -> VersionComparison:
    """Return two results of a suite compared; with the folder of the suite, its cases can be run again."""
    compared = compare_versions(workspace.existing(first), workspace.existing(second))
    return replace(compared, suite=rvsg.Suite.open(workspace.existing(suite))) if suite else compared


def still(workspace: Workspace, question: Question) -> Response:
    """Return the picture of a moment of a run, in the colours of its attempt, as SVG that stands alone."""
    campaign, run_id, index = campaign_of(workspace, question), text_of(question, "run"), number_of(question, "attempt")
    attempt = next((entry for entry in campaign.attempts() if entry.index == index), None)
    if attempt is None or run_id not in (ids := [m.run_id for m in attempt.measurements]):
        raise InputError(f"There is no run {run_id!r} in attempt {index}.")
    if (moment_s := question.t) is None:
        raise InputError("The request has no time 't'.")
    with campaign.reading() as ledger:
        runs = {key: ledger.run(key) for key in ids}
    world, robot = campaign.shown_world, campaign.plan.mission.robot_record
    plan = floor_plan(world, tooltips=False)
    head, rest = frame(runs[run_id], moment_s, look_of([*runs.values()], plan, robot), "").split(">", 1)
    floor = f'<style>{look()}{area_colours(world, plan)}</style><defs><g id="rvsg-floor">{plan.shapes}</g></defs>'
    picture = f'{head} xmlns="http://www.w3.org/2000/svg" font-family="sans-serif">{floor}{rest}'
    return Response(picture, media_type="image/svg+xml", headers={"cache-control": "private, max-age=86400"})


def picture(workspace: Workspace, question: Question) -> Response:
    """Return a picture that a model was shown."""
    content = picture_of_call(campaign_of(workspace, question), text_of(question, "digest"))
    return Response(content, media_type="image/png")


MOST_SEEDS = 20
MOST_COLOURS = 60
_editing = threading.Lock()

DROPPED = "dropped.json"


def names(workspace: Workspace, question: Question) -> dict[str, Any]:
    """Return the model that is asked, how the newest job stands, and the proposals that are left to decide on."""
    name = text_of(question, "world")
    job = workspace.jobs.of(_target(name))
    asked = asked_model(workspace)
    answer: dict[str, Any] = {"asked": asked.model_dump(mode="json"), "state": "", "said": "", "names": []}
    if job is None:
        return answer
    loaded = rvsg.load_world(world_place(workspace, question))
    areas = {area.name: area for area in loaded.areas}
    dropped, left = read_json(job.folder / DROPPED, []), []
    for label in map(ProposedLabel.model_validate, job.result.get("names", [])):
        area, values = areas.get(label.area), label.values
        if area is None or label.area in dropped or values.get("name") in areas:
            continue
        if any(getattr(area, key) != value for key, value in values.items()):
            told_of = ", ".join(value if key == "name" else f"{key} {value}" for key, value in values.items())
            left.append(label.model_dump(mode="json") | {"values": values, "words": told_of})
    for proposed in map(ProposedDoor.model_validate, job.result.get("doors", [])):
        door = proposed.door
        if door.name not in dropped and door.name not in {other.name for other in loaded.doors}:
            words = f"a {door.width_m:.2f} m {door.kind} door between {' and '.join(proposed.between)}"
            values = door.model_dump(mode="json", exclude_defaults=True)
            left.append({"area": door.name, "name": door.name, "door": values, "words": words, "why": proposed.why})
    return answer | {"state": job.state, "said": job.result.get("said") or job.result.get("reason", ""), "names": left}


def model(workspace: Workspace, question: Question) -> dict[str, Any]:
    """Keep what is typed in the fields that name a model, and return them."""
    values = {key: value for key, value in (question.asked or {}).items() if key in AskedModel.model_fields}
    return keep_model(workspace, **values).model_dump(mode="json")


def ask(workspace: Workspace, question: Question) -> dict[str, Any]:
    """Begin a job that asks a model for names."""
    name = text_of(question, "world")
    world_place(workspace, question)
    model(workspace, question)
    asked = asked_model(workspace)
    photographs = [part.strip() for part in (question.photographs or "").split(",") if part.strip()]
    shown = [workspace.relative(workspace.existing(photograph)) for photograph in photographs]
    command = f"rvsg world label {shlex.quote(name)} {asked.options}"
    command += "".join(f" --photo {shlex.quote(path)}" for path in shown)
    workspace.jobs.start("names", title="Names of areas", command=command, target=_target(name), world=name,
                         photographs=shown, access=asked.arguments)  # fmt: skip
    return names(workspace, question)


def drop(workspace: Workspace, question: Question) -> dict[str, Any]:
    """Leave a proposal out from now on."""
    job = workspace.jobs.of(_target(text_of(question, "world")))
    if job is not None:
        path = job.folder / DROPPED
        write_whole(path, json.dumps(sorted({*read_json(path, []), text_of(question, "area")})))
    return names(workspace, question)


def _target(name: str) -> str:
    return f"names in {name if name in shipped_worlds() else name.removeprefix('./')}"


_tracing = threading.Lock()


def trace(workspace: Workspace, question: Question) -> Response:
    """Return the trace of a run of a campaign or of a file of runs."""
    run = text_of(question, "run")
    with _tracing:  # one at a time: each holds about 100 MB
        if question.file:
            file, scenario = (workspace.existing(text_of(question, key)) for key in ("file", "scenario"))
            text = trace_source(file, run=run, scenario=scenario).text()
        else:
            text = kept_trace(campaign_of(workspace, question), run)
    return Response(text, media_type="application/json")


ANSWERS: dict[str, Answer] = {
    "replay": replay,
    "world": world,
    "world-check": world_check,
    "scenario": scenario,
    "runs": runs,
    "recording": recording,
    "tuning": tuning,
    "tuned": tuned,
    "versions": versions,
    "picture": picture,
    "still": still,
    "names": names,
    "typed": typed,
    "files": listed,
}
"""Questions by their address below `/data/`: they change nothing."""
CHANGES: dict[str, Answer] = {
    "world-edit": world_edit,
    "world-undo": _world_step(History.undo),
    "world-redo": _world_step(History.redo),
    "world-drive": world_drive,
    "scenario-try": scenario_try,
    "scenario-keep": scenario_keep,
    "scenario-replay": scenario_replay,
    "scenario-save": scenario_save,
    "scenario-discard": scenario_discard,
    "trace": trace,
    "names-ask": ask,
    "names-drop": drop,
    "names-model": model,
    "typed-keep": typed_keep,
    "files-forget": forget,
}
"""What may change something or takes a long question."""
LARGEST = 2_000_000
"""Bytes that a request may send."""
SCRIPTS = ("studio.js", "world.js", "pages.js", "scenario.js")
FRESH = {"cache-control": "no-cache"}


def add_data(app: FastAPI, workspace: Workspace) -> None:
    """Add the addresses of the files and data to the application."""

    @app.get("/files/{name}")
    def files(name: str) -> Response:
        if name in ("look.css", "replay.js"):
            text = look() if name == "look.css" else component()
        elif name in ("studio.css", *SCRIPTS):
            text = (resources.files("rvsg_studio") / "static" / name).read_text(encoding="utf-8")
        else:
            return Response(status_code=404)
        kind = "text/css" if name.endswith(".css") else "text/javascript"
        return Response(text, media_type=kind, headers=FRESH)

    for name, answer in ANSWERS.items():
        app.add_api_route(f"/data/{name}", _get(workspace, answer), methods=["GET"])
    for name, answer in CHANGES.items():
        app.add_api_route(f"/data/{name}", _post(workspace, answer), methods=["POST"])

    @app.post("/data/file")
    async def file(request: Request, name: str = "") -> Response:
        if request.headers.get("content-type") != "application/octet-stream":
            return JSONResponse({"error": "Expected the bytes of a file."}, status_code=415)
        content = await _limited(request, LARGEST_FILE)
        if content is None:
            return JSONResponse({"error": f"{name}: the file has more than {LARGEST_FILE} bytes."}, status_code=413)
        return await _answered(workspace, lambda place, _: receiver(name)(place, name, content), b"{}")


async def _limited(request: Request, most: int) -> bytes | None:
    """Return what a request sends; None where it is more than it may be."""
    content = bytearray()
    async for piece in request.stream():
        content += piece
        if len(content) > most:
            return None
    return bytes(content)


def _get(workspace: Workspace, answer: Answer) -> Callable[[Request], Any]:
    async def asked(request: Request) -> Response:
        return await _answered(workspace, answer, dict(request.query_params))

    return asked


def _post(workspace: Workspace, answer: Answer) -> Callable[[Request], Any]:
    async def sent(request: Request) -> Response:
        if request.headers.get("content-type", "").partition(";")[0] != "application/json":
            return JSONResponse({"error": "Expected JSON."}, status_code=415)
        content = await _limited(request, LARGEST)
        if content is None:
            return JSONResponse({"error": "The request is too large."}, status_code=413)
        return await _answered(workspace, answer, content)

    return sent


async def _answered(workspace: Workspace, answer: Answer, asked: bytes | dict[str, str]) -> Response:
    def work() -> Any:
        with permission.only():  # a request names no code of its own
            return answer(workspace, question_of(asked))

    try:
        response = await run.io_bound(work)
    except RvsgError as error:
        return JSONResponse({"error": str(error)}, status_code=400)
    return response if isinstance(response, Response) else JSONResponse(response)
