"""Whatever a damaged study folder holds, import and tables end in records and findings, or in one of our errors."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from tests.campaign.parts import MemoryLedger
from tests.study.study_files import lines_of, put, write_scenario

from rvsg.core.errors import FileError, RvsgError
from rvsg.world.world_folder import load_world
from rvsg_study.import_study import Imported, import_study, write_findings
from rvsg_study.study_format import Unreadable, as_number, read_json, read_log, read_table, small_number
from rvsg_study.table_files import write_tables

WORLD = load_world("warehouse")
ODD = (
    "",
    "²",
    "٣",
    "1e400",
    "nan",
    "-1",
    "9" * 5000,
    "9" * 25,
    "\ud800",
    "\x00",
    "x" * 200_000,
    "[" * 5000,
    "{}",
    "null",
)


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("sound") / "study"
    for scenario in range(2):
        write_scenario(root / "distance" / "route_1" / str(scenario), configurations=2, offset=0.1 * scenario)
        write_scenario(root / "no_req" / "route_1" / str(scenario), offset=0.5 + 0.1 * scenario)
    write_scenario(root / "best_scenario" / "distance" / "route_1" / "0", configurations=3)
    return root


def damage(root: Path, rng: np.random.Generator) -> None:
    """Damage one to three files: bytes, lines, cells, JSON values, or the file as a whole."""
    files = sorted(path for path in root.rglob("*") if path.is_file())
    for _ in range(int(rng.integers(1, 4))):
        path = files[int(rng.integers(len(files)))]
        if not path.is_file():
            continue
        data = bytearray(path.read_bytes())
        odd = ODD[int(rng.integers(len(ODD)))]
        match int(rng.integers(7)):
            case 0:
                data[int(rng.integers(max(1, len(data)))) : None] = b""
                path.write_bytes(bytes(data))
            case 1:
                for _ in range(int(rng.integers(1, 20))):
                    data[int(rng.integers(len(data)))] = int(rng.integers(256))
                path.write_bytes(bytes(data))
            case 2:
                path.unlink()
            case 3:
                path.unlink()
                path.mkdir()
            case 4:
                lines = path.read_text(errors="replace").split(",")
                lines[int(rng.integers(len(lines)))] = odd.encode(errors="replace").decode()
                path.write_text(",".join(lines))
            case 5 if path.suffix == ".json":
                value = json.loads(path.read_text()) if data[:1] == b"{" else {}
                if isinstance(value, dict) and value:
                    value[sorted(value)[int(rng.integers(len(value)))]] = odd
                    value[odd[:50]] = [{"Task": odd, "Path": [odd, {}, None]}]
                path.write_text(json.dumps(value))
            case _:
                path.rename(
                    path.with_name(
                        f"log_{odd[:40].encode(errors='replace').decode()}.csv".replace("/", "").replace("\x00", "")
                    )
                )


def run_through(root: Path, out: Path) -> None:
    ledger = MemoryLedger()
    done = import_study(root, ledger, WORLD)
    write_findings(done.findings, out / "findings.csv")
    write_tables(ledger, out=out)


@pytest.mark.parametrize("seed", range(1))
@pytest.mark.filterwarnings("default")
def test_a_damaged_folder_ends_in_records_or_in_one_of_our_errors(seed: int, sound: Path, tmp_path: Path) -> None:
    root = tmp_path / "study"
    shutil.copytree(sound, root)
    damage(root, np.random.default_rng(seed))
    try:
        run_through(root, tmp_path / "out")
    except RvsgError as error:
        assert str(error)


@pytest.mark.exhaustive
@pytest.mark.parametrize("seed", range(1, 40))
def test_more_damaged_folders(seed: int, sound: Path, tmp_path: Path) -> None:
    test_a_damaged_folder_ends_in_records_or_in_one_of_our_errors(seed, sound, tmp_path)


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
    assert small_number("12") == 12
    assert [small_number(text) for text in ("²", "٣", "1234567", "-1", "")] == [None] * 5


@pytest.mark.parametrize("text", ["", "[" * 100_000, '{"a": NaN}', '"\\ud800"', "9" * 5000, "{"])
def test_json_that_nothing_can_use_is_unreadable(text: str, tmp_path: Path) -> None:
    path = tmp_path / "x.json"
    path.write_text(text)
    with pytest.raises(Unreadable):
        read_json(path)


def test_a_device_without_end_is_unreadable() -> None:
    with pytest.raises(Unreadable):
        read_json(Path("/dev/zero"))


def test_a_column_that_occurs_twice_is_unreadable(tmp_path: Path) -> None:
    path = tmp_path / "x.csv"
    path.write_text("a,a\n1,2\n")
    with pytest.raises(Unreadable):
        read_table(path)


def test_a_step_too_short_for_any_clock_makes_a_log_unusable(sound: Path, tmp_path: Path) -> None:
    path = tmp_path / "log_0.csv"
    rows = lines_of(sound / "distance" / "route_1" / "0" / "log_0.csv")
    rows[2][0] = "1e-9"
    put(path, rows)
    with pytest.raises(Unreadable):
        read_log(path)
