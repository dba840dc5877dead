"""Kinds of input: a whole example of each, and the command that reads it."""

from __future__ import annotations

import contextlib
import io
import json
import shlex
import struct
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from PIL import Image
from tests.campaign.parts import WalkGenerator, plan, warehouse
from tests.study.study_files import write_scenario

from rvsg.cli import main
from rvsg.generation.generator import Proposal
from rvsg.generation.replies import read_configuration, read_description, read_path_lines
from rvsg.scenario.brief import Brief
from rvsg.scenario.repair import repair
from rvsg.scenario.scenario import Scenario
from rvsg.scenario.validity import check
from rvsg.simulation.archive import run_to_json
from rvsg.simulation.kinematic import KinematicSimulator

DATA = Path(__file__).parents[2] / "src" / "rvsg"
Files = Mapping[str, bytes]


@dataclass(frozen=True)
class Kind:
    """One kind of input."""

    name: str
    command: str | Callable[[Path], int]
    """The command line that reads the folder, `{}` in it, or a function that reads it and returns an exit code."""
    files: Callable[[], Files]
    """Make a whole example: files by name."""
    undamaged: tuple[str, ...] = ()
    """Files of the example that are never damaged."""
    silent: bool = False
    """With exit code 0 the output has to be that of the undamaged example."""

    def write(self, folder: Path) -> list[Path]:
        """Write the example and return the files that may be damaged."""
        for name, content in self.files().items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes(content)
        return [folder / name for name in self.files() if name not in self.undamaged]

    def read(self, folder: Path, *options: str) -> int:
        """Let the program read the folder, and return its exit code."""
        if isinstance(self.command, str):
            return main([*options, *(word.format(folder) for word in shlex.split(self.command))])
        return self.command(folder)


@cache
def scenario() -> Scenario:
    brief = Brief(mission=plan().mission, requirement=plan().requirement, seed=3)
    found = WalkGenerator().propose(brief, warehouse()).scenario
    assert found is not None
    return found


def scenario_file() -> Files:
    return {"s.json": scenario().to_json().encode()}


@cache
def runs() -> Files:
    run = KinematicSimulator().run(scenario(), warehouse(), seed=1)
    return {"runs.jsonl": run_to_json(run).encode()}


def files_in(folder: Path, pattern: str, at: str = "") -> Files:
    found = sorted(path for path in folder.rglob(pattern) if path.is_file())
    return {f"{at}{path.relative_to(folder)}": path.read_bytes() for path in found}


def map_files() -> Files:
    image = Image.new("L", (40, 30), 254)
    for x in range(40):
        image.putpixel((x, 0), 0)
        image.putpixel((x, 29), 0)
    buffer = io.BytesIO()
    image.save(buffer, "PPM")
    text = "image: m.pgm\nresolution: 0.1\norigin: [-2.0, -1.5, 0.0]\nnegate: 0\n"
    text += "occupied_thresh: 0.65\nfree_thresh: 0.25\n"
    return {"m.yaml": text.encode(), "m.pgm": buffer.getvalue()}


CORNERS = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
FACES = ["015", "054", "126", "165", "237", "276", "304", "347", "021", "032", "456", "467"]
OBJ = b"v 0 0 0\nv 2 0 0\nv 2 1 0\nv 0 1 0\nv 0 0 1\nv 2 0 1\nv 2 1 1\nv 0 1 1\n" + b"".join(
    b"f %d %d %d %d\n" % face
    for face in ((1, 2, 3, 4), (5, 6, 7, 8), (1, 2, 6, 5), (2, 3, 7, 6), (3, 4, 8, 7), (4, 1, 5, 8))
)
PARTS = {
    "1 1 0.5 0 0 0.3": "<box><size>1 2 1</size></box>",
    "4 1 1 0 0 0": "<cylinder><radius>0.4</radius><length>2</length></cylinder>",
    "6 3 0 0 0 0": "<mesh><uri>box.stl</uri><scale>1 1 1</scale></mesh>",
    "2 5 0 0 0 1": "<mesh><uri>box.obj</uri></mesh>",
    "7 6 0 0 0 0": "<polyline><point>0 0</point><point>1 0</point><point>0 1</point><height>1</height></polyline>",
}


def model(geometry: str, pose: str, name: str) -> str:
    return (
        f"<model name='{name}'><static>1</static><pose>{pose}</pose><link name='l'>"
        f"<collision name='c'><geometry>{geometry}</geometry></collision></link></model>"
    )


def sdf_files() -> Files:
    inside = "".join(model(geometry, pose, f"m{pose[:2].strip()}") for pose, geometry in PARTS.items())
    text = f"<?xml version='1.0'?>\n<sdf version='1.7'>\n<world name='w'>\n{inside}\n</world></sdf>"
    triangles = (struct.pack("<12fH", 0, 0, 0, *(c for k in face for c in CORNERS[int(k)]), 0) for face in FACES)
    stl = bytes(80) + struct.pack("<I", len(FACES)) + b"".join(triangles)
    return {"a.sdf": text.encode(), "box.stl": stl, "box.obj": OBJ}


REQUIREMENT = """mine:
  title: Keep away
  text: The robot keeps away from people.
"""
METRIC = f"{REQUIREMENT}  metric: dto\n  worse: smaller\n  limit: 0.5\n  unit: m\n".encode()
FORMULA = f"{REQUIREMENT}  formula: always[0, 20](distance_to_person > 0.3 or speed < 0.1)\n".encode()
CAMPAIGN = b"""world: warehouse
route: route_1
requirement: R1
generator: random
strategy: study
simulator: kinematic
simulator_options: {}
humans: 2
scenarios: 2
refinements: 1
repeats: 2
confirmations: 3
memory: 10
seed: 3
"""


@cache
def campaign_folder() -> Files:
    """The folder of a small campaign."""
    with tempfile.TemporaryDirectory() as name, contextlib.redirect_stderr(io.StringIO()):
        (Path(name) / "c.yaml").write_bytes(CAMPAIGN)
        with contextlib.redirect_stdout(io.StringIO()):
            assert main(["run", f"{name}/c.yaml", "--jobs", "1", "--out", f"{name}/out"]) == 0
        return files_in(Path(name) / "out", "*", "out/")


@cache
def study_folder() -> Files:
    with tempfile.TemporaryDirectory() as name:
        for requirement in ("distance", "jerk"):
            folder = Path(name) / requirement / "route_1" / "0"
            write_scenario(folder, requirement=requirement, configurations=2)
        return files_in(Path(name), "*", "s/")


def person(name: str, /, **changes: object) -> dict[str, object]:
    tasks = [{"task": "a → b", "path": ["G7", "G8", "G9"], "pauses": [{"at": "G9", "duration_s": 3}]}]
    moved = {"name": name, "speed_m_s": 1.2, "start_delay_s": 2, "group": 1, "behaviour": "regular", "tasks": tasks}
    return moved | changes


def answer_file() -> Files:
    people = {"description": "People carry boxes.", "humans": [person(f"Human {n}") for n in (1, 2)]}
    return {"answer.txt": f"Here it is:\n```json\n{json.dumps(people, indent=1)}\n```\n".encode()}


def read_answer(folder: Path) -> int:
    """Read an answer as the conversation does, and write the records that hold it."""
    text = (folder / "answer.txt").read_bytes().decode(errors="replace")
    names = ("Human 1", "Human 2")
    read_path_lines(text, names)
    description = read_description(text)
    reply = read_configuration(text, names)
    people, made = reply.people, None
    if people is not None and not reply.fatal:
        people, _ = repair(people, plan().mission, warehouse())
        check(people, plan().mission, warehouse())
        made = Scenario(mission=plan().mission, people=people, description=description)
    proposal = Proposal(generator="vlm", scenario=made, reasoning=reply.analysis, problems=reply.findings)
    proposal.to_json().encode()
    assert Proposal.from_json(proposal.to_json()).id == proposal.id
    return 0


def read_option(folder: Path) -> int:
    text = (folder / "o.txt").read_bytes().decode("utf-8", "surrogateescape").replace("\0", "")
    options = ["--simulator", "kinematic", "--simulator-option", text, "--out", f"{folder}/r"]
    return main(["--debug", "simulate", f"{folder}/s.json", *options])


KINDS = (
    Kind("campaign", "scenario prompt {}/c.yaml", lambda: {"c.yaml": CAMPAIGN}),
    Kind(
        "world",
        "world check {}/w --no-simulation",
        lambda: files_in(DATA / "world" / "worlds" / "warehouse", "*.yaml", "w/"),
    ),
    Kind(
        "objects world",
        "world check {}/w --no-simulation",
        lambda: files_in(DATA / "world" / "worlds" / "office", "*.yaml", "w/"),
    ),
    Kind("map", "world new {}/w --no-simulation --map {}/m.yaml", map_files),
    Kind("sdf", "world new {}/w --no-simulation --sdf {}/a.sdf", sdf_files),
    Kind(
        "objects",
        "world new {}/w --no-simulation --objects {}/objects.yaml",
        lambda: files_in(DATA / "world" / "worlds" / "office", "objects.yaml"),
    ),
    *(
        Kind(
            name,
            "evaluate {}/runs.jsonl --requirement {}/r.yaml --json",
            lambda text=text: {**runs(), "r.yaml": text},  # type: ignore[misc]
            undamaged=("runs.jsonl",),
        )
        for name, text in (("requirement", METRIC), ("formula", FORMULA))
    ),
    Kind("scenario", "simulate {}/s.json --simulator kinematic --out {}/runs.jsonl", scenario_file),
    Kind("runs", "evaluate {}/runs.jsonl --json", runs),
    Kind("study", "import study {}/s --out {}/store", study_folder),
    Kind("answer", read_answer, answer_file),
    Kind(
        "store",
        "report {}/out --json --html {}/p.html",
        campaign_folder,
        undamaged=("out/best_scenario.json", "out/campaign.yaml", "out/report.html"),
        silent=True,
    ),
    Kind("folder", "run --out {}/out --jobs 1", campaign_folder, undamaged=("out/report.html",)),
    Kind("option", read_option, lambda: {**scenario_file(), "o.txt": b"stop_gap_m=0.3"}, undamaged=("s.json",)),
    Kind(
        "robot", "robots {}/r.yaml --json", lambda: {"r.yaml": (DATA / "robots" / "data" / "tugger.yaml").read_bytes()}
    ),
)
