"""Every `rvsg` command that a page shows: the real command line reads it, and it runs where that is cheap.

A page's commands run in their order, in a folder with the files that pages speak of. `NOT_RUN` says of the others why.
"""

from __future__ import annotations

import contextlib
import io
import re
import shlex
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest
import yaml
from tests.world.test_create_and_check import hall, write_map

import rvsg
from rvsg.cli import VERBS, main
from rvsg.cli.frame import full_command, installed_verbs
from rvsg.world.world_folder import SHIPPED

ROOT = Path(__file__).parents[2]
FOLDERS = ("docs", "examples", "packages")
FOUND = [*ROOT.glob("*.md"), *(path for name in FOLDERS for path in (ROOT / name).rglob("*.md"))]
CONSOLE = r"^```(?:console|sh|bash|shell)\n(.*?)^```"
PAGES = sorted(path.relative_to(ROOT).as_posix() for path in FOUND)


class Shown(NamedTuple):
    """A line of commands on a page, and the place its output goes to."""

    text: str
    commands: tuple[tuple[str, ...], ...]
    into: str


def shown_on(page: str) -> Iterator[Shown]:
    """Yield the lines of a page's console blocks that call rvsg."""
    text = (ROOT / page).read_text(encoding="utf-8")
    for block in re.findall(CONSOLE, text, flags=re.S | re.M):
        for line in re.sub(r"\\\n\s*", " ", block).splitlines():
            if (found := re.match(r"\$ (?:\.venv/bin/)?(rvsg .*)", line)) is None:
                continue
            words = shlex.split(found[1], comments=True)
            into = words.pop() if ">" in words else ""
            words = [word for word in words if word != ">"]
            pipeline = " ".join("\n" if word == "|" else shlex.quote(word) for word in words).split("\n")
            yield Shown(found[1], tuple(tuple(shlex.split(each)[1:]) for each in pipeline), into)


SHOWN = {page: shown for page in PAGES if (shown := list(shown_on(page)))}


@pytest.mark.parametrize("page", SHOWN)
def test_the_command_line_reads_every_command_of_a_page(page: str) -> None:
    verbs = installed_verbs(VERBS)
    for shown in SHOWN[page]:
        for name, *words in shown.commands:
            command = full_command(name, verbs[name])
            while commands := getattr(command, "commands", None):
                command, words = commands[words[0]], words[1:]
            command.make_context(name, words)


CAMPAIGN = "a campaign of minutes; tests/cli runs smaller ones"
ROS2 = "needs ROS 2; tests/plugins stands in for it"
MODEL = "needs a model; tests/cli and tests/generation have one of their own"
OTHERS = "needs files of another project; tests/exchange reads such ones"
COMPILER = "needs a compiler; tests/simulation has one"
NOT_RUN = {
    **dict.fromkeys(("rvsg run --robot", "rvsg run --stack", "rvsg run --world", "rvsg run --route"), CAMPAIGN),
    **dict.fromkeys(("rvsg run --model", "rvsg run --replay", "rvsg world describe"), MODEL),
    **dict.fromkeys(("rvsg scenario propose --generator vlm", "rvsg scenario prompt runs/first-vlm"), MODEL),
    **dict.fromkeys((f"rvsg world {verb} hospital-floor" for verb in ("new", "draw", "check")), OTHERS),
    "rvsg run --strategy study --max-in-flight": "needs a cluster; tests/campaign starts one",
    "rvsg run --jobs 1 --stack ros2": ROS2,
    "rvsg ros2 params": ROS2,
    "rvsg simulate scenario.json --simulator ros2-world": ROS2,
    "rvsg simulate runs/first/best_scenario.json --stack exec:./my_planner": COMPILER,
    "rvsg replay runs/first --trace --run run-": "the run's id stands for one of yours",
    "rvsg replay runs.jsonl --trace --scenario scenario.json --run run-": "the run's id stands for one of yours",
    "rvsg scenario shrink": "minutes; tests/cli/test_documented_shrink.py runs it and compares what it prints",
    "rvsg stacks suite/": "needs a stack of your own; the page shows the same on runs/first",
    "rvsg tune": "thousands of runs; tests/app tunes with fewer",
    "rvsg studio": "serves until it is interrupted; tests/studio uses it",
    "rvsg watch": "works for an hour; tests/app watches for seconds",
    "rvsg import study": "needs the data of the study; tests/study reads it",
    "rvsg report runs/published": "needs the data of the study; tests/study writes its tables",
    "rvsg knowledge status": "needs a database server; tests/store has one",
}
"""Why commands that begin so are not run here."""
ELSEWHERE = {
    "make ": "installs into .venv; .ci/run and the release checklist run them",
    ".venv/bin/pip install -c constraints.txt ": "tests/architecture/test_install_lines.py holds the one form",
    "pip install --find-links dist ": "tests/plugins/test_distributions.py installs the wheels",
    "source .venv/bin/activate": "changes the shell alone",
    "pytest --rvsg-suite suite": "tests/app runs the plug-in of pytest",
    ".venv/bin/python examples/field_robot.py field ": "works for an hour; tests/app watches for seconds",
    "g++ ": COMPILER,
    "dask ": "needs a cluster; tests/campaign starts one",
    "git clone ": OTHERS,
    "export ": "sets a variable of the shell",
    "ros2 ": ROS2,
}
"""Why commands of other programs are not run here, by how they begin."""
FILES = """
simulate scenario.json --world worlds/site --bag incident.mcap --out site.jsonl
simulate scenario.json --out runs.jsonl
export examples/three_people.json --to hunav --out agents.yaml
export scenario.json --to sdf --out hall.world
suite add runs/second/best_scenario.json --suite suite
"""
"""Commands that make files which pages speak of."""


def reason(text: str) -> str:
    """Return why a command is not run; empty where it is."""
    plain = " ".join(shlex.split(text, comments=True))
    return next((why for begin, why in NOT_RUN.items() if plain.startswith(begin)), "")


RUN = {page: run for page, shown in SHOWN.items() if (run := [each for each in shown if not reason(each.text)])}


@pytest.fixture(scope="session")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The files that pages speak of; they are only ever copied."""
    made = tmp_path_factory.mktemp("pages")
    small = {"scenarios": 1, "refinements": 0, "repeats": 2, "confirmations": 4}
    for seed, name in ((1, "runs/first"), (11, "runs/second")):
        campaign = rvsg.Campaign.create(made / name, seed=seed, jobs=1, **small)
        list(campaign.run())
        campaign.report()
    (made / "campaign.yaml").write_text(yaml.safe_dump(small), encoding="utf-8")
    shutil.copy(made / "runs/first/best_scenario.json", made / "scenario.json")
    shutil.copytree(SHIPPED / "warehouse", made / "worlds/site")
    routes = made / "worlds/site/routes.yaml"
    routes.write_text(routes.read_text(encoding="utf-8").replace("route_1", "dock_to_gate"), encoding="utf-8")
    write_map(made, hall()).rename(made / "map.yaml")
    page = (ROOT / "docs/how-to/test-another-robot.md").read_text(encoding="utf-8")
    (robot,) = re.findall(r"```yaml\n(name: .*?)```", page, flags=re.S)
    (made / "my_robot.yaml").write_text(robot, encoding="utf-8")
    shutil.copy(ROOT / "src/rvsg/robots/data/tiago_omni.yaml", made / "slower.yaml")
    shutil.copy(ROOT / "examples/stacks/nav2_params.yaml", made)
    (made / "examples").symlink_to(ROOT / "examples")
    (made / "models").mkdir()
    with contextlib.chdir(made):
        assert [main(line.split()) for line in FILES.strip().splitlines()] == [0] * 5
    (made / "recordings").mkdir()
    shutil.copy(made / "incident.mcap", made / "recordings")
    return made


@pytest.mark.slow
@pytest.mark.parametrize("page", RUN)
def test_the_commands_of_a_page_run_in_their_order(
    page: str, files: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(files, tmp_path, symlinks=True, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    for shown in RUN[page]:
        given = ""
        for words in shown.commands:
            monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(given.encode())))
            capsys.readouterr()
            ended = main(list(words))
            given, told = capsys.readouterr()
            assert ended == 0 or (ended == 1 and "--fail-on-violation" in words), (shown.text, told)
        if shown.into:
            Path(shown.into).write_text(given, encoding="utf-8")


def test_every_reason_not_to_run_a_command_is_about_one_that_is_shown() -> None:
    shown = [" ".join(shlex.split(each.text, comments=True)) for page in SHOWN.values() for each in page]
    assert [begin for begin in NOT_RUN if not any(text.startswith(begin) for text in shown)] == []
    assert sum(map(len, SHOWN.values())) > 80 and sum(map(len, RUN.values())) > 50


def console_lines(page: str) -> list[str]:
    """Return the commands in the console blocks of a page."""
    blocks = re.findall(CONSOLE, (ROOT / page).read_text(encoding="utf-8"), flags=re.S | re.M)
    return [line[2:] for block in blocks for line in block.splitlines() if line.startswith("$ ")]


def test_commands_of_other_programs_say_why_they_are_not_run() -> None:
    lines = [line for page in PAGES for line in console_lines(page)]
    others = [line for line in lines if not re.match(r"(\.venv/bin/)?rvsg ", line)]
    assert [line for line in others if not line.startswith(tuple(ELSEWHERE))] == []
    assert [begin for begin in ELSEWHERE if not any(line.startswith(begin) for line in others)] == []


@pytest.mark.parametrize("page", PAGES)
def test_a_command_within_a_sentence_exists_with_its_options(page: str) -> None:
    verbs = installed_verbs(VERBS)
    text = re.sub(CONSOLE, "", (ROOT / page).read_text(encoding="utf-8"), flags=re.S | re.M)
    for said in re.findall(r"`(?:\.venv/bin/)?rvsg ([a-z][^`]*)`", text) if page != "CHANGELOG.md" else ():
        name, *words = said.split()
        command = full_command(name, verbs[name], everything=True)
        while words and (commands := getattr(command, "commands", None)):
            command, words = commands[words[0]], words[1:]
        known = {option for each in command.params for option in (*each.opts, *each.secondary_opts)}
        asked = {word.partition("=")[0] for word in words if word.startswith("--")}
        assert asked <= known | {"--help", "--help-all", "--budget-..."}, said
