"""Whatever a damaged study folder holds, import and tables end in records and findings, or in one of our errors."""

from __future__ import annotations

import json
import random
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from tests.campaign.parts import MemoryLedger
from tests.study.study_files import lines_of, put, write_scenario

from rvsg.core.errors import FileError, RvsgError
from rvsg.world.world_folder import load_world
from rvsg_study.import_study import Imported, import_study, write_findings
from rvsg_study.study_format import Unreadable, as_number, read_json, read_log, read_table, small_number
from rvsg_study.table_files import write_tables

WORLD = load_world("warehouse")
ODD = ("", "²", "٣", "1e400", "nan", "-1", "9" * 5000, "9" * 25, "\x00", "x" * 200_000, "[" * 5000, "{}", "null")


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("sound") / "study"
    for scenario in range(2):
        write_scenario(root / "distance" / "route_1" / str(scenario), configurations=2, offset=0.1 * scenario)
        write_scenario(root / "no_req" / "route_1" / str(scenario), offset=0.5 + 0.1 * scenario)
    write_scenario(root / "best_scenario" / "distance" / "route_1" / "0", configurations=3)
    return root


def renamed(path: Path, odd: str) -> None:
    path.rename(path.with_name(f"log_{odd[:40]}.csv".replace("\x00", "")))


def a_folder(path: Path, _odd: str) -> None:
    path.unlink()
    path.mkdir()


def with_odd_values(path: Path, odd: str) -> None:
    value = json.loads(path.read_text()) if path.suffix == ".json" else {}
    value |= dict.fromkeys(sorted(value)[:1], odd) | {odd[:50]: [{"Task": odd, "Path": [odd, {}, None]}]}
    path.write_text(json.dumps(value))


def run_through(root: Path, out: Path) -> None:
    ledger = MemoryLedger()
    done = import_study(root, ledger, WORLD)
    write_findings(done.findings, out / "findings.csv")
    write_tables(ledger, out=out)


@pytest.mark.parametrize("damage", [renamed, a_folder, with_odd_values, lambda path, _: path.unlink()])
@pytest.mark.filterwarnings("default")
def test_a_damaged_folder_ends_in_records_or_in_one_of_our_errors(
    damage: Callable[[Path, str], None], sound: Path, tmp_path: Path
) -> None:
    """Damage to the bytes of a file is tried by tests/fuzz."""
    chance = random.Random(damage.__name__)
    for k in range(3):
        root = tmp_path / f"study {k}"
        shutil.copytree(sound, root)
        for path in chance.sample(sorted(each for each in root.rglob("*") if each.is_file()), 2):
            damage(path, chance.choice(ODD))
        try:
            run_through(root, tmp_path / f"out {k}")
        except RvsgError as error:
            assert str(error)


def test_a_cell_that_holds_one_scenario_has_a_table(tmp_path: Path) -> None:
    write_scenario(tmp_path / "study" / "distance" / "route_1" / "0")
    (tmp_path / "out").mkdir()
    run_through(tmp_path / "study", tmp_path / "out")
    assert (tmp_path / "out" / "honest" / "rq1.csv").exists()


def test_scenarios_without_people_or_with_other_numbers_of_people_are_not_compared(tmp_path: Path) -> None:
    for number in range(3):
        write_scenario(tmp_path / "study" / "distance" / "route_1" / str(number))
    (tmp_path / "study" / "distance" / "route_1" / "0" / "distance_model_0.json").write_text("{}")
    log = tmp_path / "study" / "distance" / "route_1" / "1" / "log_0.csv"
    rows = lines_of(log)
    put(log, [[cell for name, cell in zip(rows[0], row, strict=True) if "worker2" not in name] for row in rows])
    (tmp_path / "out").mkdir()
    run_through(tmp_path / "study", tmp_path / "out")


def test_a_table_of_findings_that_is_none_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "findings.csv"
    path.write_text("a,b\n1,2\n")
    with pytest.raises(FileError):
        write_findings(Imported().findings, path, keep=True)


@pytest.mark.parametrize("text", ["1e10", "nan", "inf", "", "x", "9" * 400])
def test_a_number_that_no_run_can_have_is_none(text: str) -> None:
    assert as_number(text) is None


def test_numbers_of_files_are_short_and_ascii() -> None:
    assert [small_number(text) for text in ("12", "²", "٣", "1234567", "-1", "")] == [12, *[None] * 5]


@pytest.mark.parametrize(
    ("read", "text"),
    [
        *((read_json, text) for text in ("", "[" * 100_000, '{"a": NaN}', '"\\ud800"', "9" * 5000, "{")),
        (read_table, "a,a\n1,2\n"),  # a column twice
        (read_json, None),
    ],
)
def test_a_file_that_nothing_can_use_is_unreadable(
    read: Callable[[Path], object], text: str | None, tmp_path: Path
) -> None:
    path = tmp_path / "x" if text is not None else Path("/dev/zero")
    if text is not None:
        path.write_text(text)
    with pytest.raises(Unreadable):
        read(path)


def test_a_step_too_short_for_any_clock_makes_a_log_unusable(sound: Path, tmp_path: Path) -> None:
    path = tmp_path / "log_0.csv"
    rows = lines_of(sound / "distance" / "route_1" / "0" / "log_0.csv")
    rows[2][0] = "1e-9"
    put(path, rows)
    with pytest.raises(Unreadable):
        read_log(path)
