"""The kinds of input: whole examples of each, and the command that reads them.

A Kind writes its example into a folder and names the files that may be damaged; `argv` is the command line that reads
them. A kind whose result must not change in silence gives `silent`: with exit code 0 its output has to be that of the
undamaged input.
"""

from __future__ import annotations

import contextlib
import io
import json
import struct
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from PIL import Image
from tests.campaign.parts import WalkGenerator, plan, warehouse

from rvsg.cli import main
from rvsg.generation.generator import Proposal
from rvsg.generation.replies import read_configuration, read_description, read_path_lines
from rvsg.scenario.brief import Brief
from rvsg.scenario.repair import repair
from rvsg.scenario.scenario import Scenario
from rvsg.scenario.validity import check
from rvsg.simulation.archive import run_to_json
from rvsg.simulation.kinematic import KinematicSimulator

WORLDS = Path(__file__).parents[2] / "src" / "rvsg" / "world" / "worlds"
ROBOTS = Path(__file__).parents[2] / "src" / "rvsg" / "robots" / "data"


@dataclass(frozen=True)
class Kind:
    """One kind of input."""

    name: str
    write: Callable[[Path], list[Path]]
    """Writes a whole example into an empty folder and returns the files to damage."""
    argv: Callable[[Path], list[str]] | None = None
    """The command that reads the folder."""
    call: Callable[[Path], None] | None = None
    """Instead of a command: what reads the folder, raising nothing."""
    silent: bool = False


@cache
def _scenario() -> Scenario:
    brief = Brief(mission=plan().mission, requirement=plan().requirement, seed=3)
    found = WalkGenerator().propose(brief, warehouse()).scenario
    assert found is not None
    return found


@cache
def _runs_text() -> str:
    run = KinematicSimulator().run(_scenario(), warehouse(), seed=1)
    return run_to_json(run)


def _written(path: Path, content: str | bytes) -> list[Path]:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return [path]


def _world(name: str) -> Callable[[Path], list[Path]]:
    def write(folder: Path) -> list[Path]:
        return [
            path
            for file in sorted((WORLDS / name).glob("*.yaml"))
            for path in _written(folder / "w" / file.name, file.read_bytes())
        ]

    return write


def _map(folder: Path) -> list[Path]:
    image = Image.new("L", (40, 30), 254)
    for x in range(40):
        image.putpixel((x, 0), 0)
        image.putpixel((x, 29), 0)
    buffer = io.BytesIO()
    image.save(buffer, "PPM")
    text = "image: m.pgm\nresolution: 0.1\norigin: [-2.0, -1.5, 0.0]\nnegate: 0\n"
    text += "occupied_thresh: 0.65\nfree_thresh: 0.25\n"
    return _written(folder / "m.yaml", text) + _written(folder / "m.pgm", buffer.getvalue())


def _stl() -> bytes:
    corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
    faces = [
        (0, 1, 5),
        (0, 5, 4),
        (1, 2, 6),
        (1, 6, 5),
        (2, 3, 7),
        (2, 7, 6),
        (3, 0, 4),
        (3, 4, 7),
        (0, 2, 1),
        (0, 3, 2),
    ]
    faces += [(4, 5, 6), (4, 6, 7)]
    records = b"".join(struct.pack("<12fH", 0, 0, 0, *(c for k in face for c in corners[k]), 0) for face in faces)
    return bytes(80) + struct.pack("<I", len(faces)) + records


OBJ = b"v 0 0 0\nv 2 0 0\nv 2 1 0\nv 0 1 0\nv 0 0 1\nv 2 0 1\nv 2 1 1\nv 0 1 1\n" + b"".join(
    b"f %d %d %d %d\n" % face
    for face in ((1, 2, 3, 4), (5, 6, 7, 8), (1, 2, 6, 5), (2, 3, 7, 6), (3, 4, 8, 7), (4, 1, 5, 8))
)


def _sdf(folder: Path) -> list[Path]:
    def part(geometry: str, pose: str) -> str:
        return (
            f"<model name='m{pose[:2].strip()}'><static>1</static><pose>{pose}</pose><link name='l'>"
            f"<collision name='c'><geometry>{geometry}</geometry></collision></link></model>"
        )

    inside = (
        part("<box><size>1 2 1</size></box>", "1 1 0.5 0 0 0.3")
        + part("<cylinder><radius>0.4</radius><length>2</length></cylinder>", "4 1 1 0 0 0")
        + part("<mesh><uri>box.stl</uri><scale>1 1 1</scale></mesh>", "6 3 0 0 0 0")
        + part("<mesh><uri>box.obj</uri></mesh>", "2 5 0 0 0 1")
        + part(
            "<polyline><point>0 0</point><point>1 0</point><point>0 1</point><height>1</height></polyline>",
            "7 6 0 0 0 0",
        )
    )
    text = f"<?xml version='1.0'?>\n<sdf version='1.7'>\n<world name='w'>\n{inside}\n</world></sdf>"
    return [
        *_written(folder / "a.sdf", text),
        *_written(folder / "box.stl", _stl()),
        *_written(folder / "box.obj", OBJ),
    ]


REQUIREMENT = """mine:
  title: Keep away
  text: The robot keeps away from people.
  metric: dto
  worse: smaller
  limit: 0.5
  unit: m
"""

FORMULA = """mine:
  title: Keep away
  text: The robot keeps away from people.
  formula: always[0, 20](distance_to_person > 0.3 or speed < 0.1)
"""


def _requirement(text: str) -> Callable[[Path], list[Path]]:
    def write(folder: Path) -> list[Path]:
        _written(folder / "runs.jsonl", _runs_text())
        return _written(folder / "r.yaml", text)

    return write


CAMPAIGN = """world: warehouse
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


def _quietly(argv: list[str]) -> int:
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        return main(argv)


@cache
def _campaign_files() -> dict[str, bytes]:
    """The folder of a small campaign."""
    import tempfile

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "out"
        _written(Path(name) / "c.yaml", CAMPAIGN)
        assert _quietly(["run", str(Path(name) / "c.yaml"), "--jobs", "1", "--out", str(folder)]) == 0
        return {file.name: file.read_bytes() for file in folder.iterdir() if file.is_file()}


def _store(folder: Path) -> list[Path]:
    for name, content in _campaign_files().items():
        _written(folder / "out" / name, content)
    return [folder / "out" / "ledger.sqlite"]


def _campaign_folder(folder: Path) -> list[Path]:
    _store(folder)
    return sorted(file for file in (folder / "out").iterdir() if file.suffix in (".json", ".yaml", ".sqlite"))


def _study(folder: Path) -> list[Path]:
    from tests.study.study_files import write_scenario

    for requirement in ("distance", "jerk"):
        write_scenario(folder / "s" / requirement / "route_1" / "0", requirement=requirement, configurations=2)
    return sorted(path for path in (folder / "s").rglob("*") if path.is_file())


def _answers(folder: Path) -> list[Path]:
    people = {
        "description": "People carry boxes.",
        "humans": [
            {
                "name": f"Human {n}",
                "speed_m_s": 1.2,
                "start_delay_s": 2,
                "group": 1,
                "behaviour": "regular",
                "tasks": [{"task": "a → b", "path": ["G7", "G8", "G9"], "pauses": [{"at": "G9", "duration_s": 3}]}],
            }
            for n in (1, 2)
        ],
    }
    return _written(folder / "answer.txt", "Here it is:\n```json\n" + json.dumps(people, indent=1) + "\n```\n")


def _read_answer(folder: Path) -> None:
    """Read an answer as the conversation does, and write the records that hold it."""
    text = (folder / "answer.txt").read_bytes().decode(errors="replace")
    names = ("Human 1", "Human 2")
    read_path_lines(text, names)
    description = read_description(text)
    reply = read_configuration(text, names)
    people, scenario = reply.people, None
    if people is not None and not reply.fatal:
        people, _ = repair(people, plan().mission, warehouse())
        check(people, plan().mission, warehouse())
        scenario = Scenario(mission=plan().mission, people=people, description=description)
    proposal = Proposal(generator="vlm", scenario=scenario, reasoning=reply.analysis, problems=reply.findings)
    proposal.to_json().encode()
    assert Proposal.from_json(proposal.to_json()).id == proposal.id


def _options(folder: Path) -> list[Path]:
    _written(folder / "s.json", _scenario().to_json())
    return _written(folder / "o.txt", "stop_gap_m=0.3")


def _option_argv(folder: Path) -> list[str]:
    text = (folder / "o.txt").read_bytes().decode("utf-8", "surrogateescape").replace("\0", "")
    return [
        "simulate",
        str(folder / "s.json"),
        "--simulator",
        "kinematic",
        "--simulator-option",
        text,
        "--out",
        str(folder / "r"),
    ]


def _robot(folder: Path) -> list[Path]:
    return _written(folder / "r.yaml", (ROBOTS / "tugger.yaml").read_bytes())


KINDS = (
    Kind("campaign", lambda f: _written(f / "c.yaml", CAMPAIGN), lambda f: ["scenario", "prompt", str(f / "c.yaml")]),
    Kind("world", _world("warehouse"), lambda f: ["world", "check", str(f / "w"), "--no-simulation"]),
    Kind("objects world", _world("office"), lambda f: ["world", "check", str(f / "w"), "--no-simulation"]),
    Kind("map", _map, lambda f: ["world", "new", str(f / "w"), "--no-simulation", "--map", str(f / "m.yaml")]),
    Kind("sdf", _sdf, lambda f: ["world", "new", str(f / "w"), "--no-simulation", "--sdf", str(f / "a.sdf")]),
    Kind(
        "objects",
        lambda f: _written(f / "objects.yaml", (WORLDS / "office" / "objects.yaml").read_bytes()),
        lambda f: ["world", "new", str(f / "w"), "--no-simulation", "--objects", str(f / "objects.yaml")],
    ),
    Kind(
        "requirement",
        _requirement(REQUIREMENT),
        lambda f: ["evaluate", str(f / "runs.jsonl"), "--requirement", str(f / "r.yaml"), "--json"],
    ),
    Kind(
        "formula",
        _requirement(FORMULA),
        lambda f: ["evaluate", str(f / "runs.jsonl"), "--requirement", str(f / "r.yaml"), "--json"],
    ),
    Kind(
        "scenario",
        lambda f: _written(f / "s.json", _scenario().to_json()),
        lambda f: ["simulate", str(f / "s.json"), "--simulator", "kinematic", "--out", str(f / "runs.jsonl")],
    ),
    Kind(
        "runs",
        lambda f: _written(f / "runs.jsonl", _runs_text()),
        lambda f: ["evaluate", str(f / "runs.jsonl"), "--json"],
    ),
    Kind("study", _study, lambda f: ["import", "study", str(f / "s"), "--out", str(f / "store")]),
    Kind("answer", _answers, call=_read_answer),
    Kind("store", _store, lambda f: ["report", str(f / "out"), "--json", "--html", str(f / "p.html")], silent=True),
    Kind("folder", _campaign_folder, lambda f: ["run", "--out", str(f / "out"), "--jobs", "1"]),
    Kind("option", _options, _option_argv),
    Kind("robot", _robot, lambda f: ["robots", str(f / "r.yaml"), "--json"]),
)
