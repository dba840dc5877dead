from __future__ import annotations

import shutil
import sqlite3
import threading
import zlib
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.campaign.parts import WalkGenerator, plan, warehouse
from tests.coded import coded

from rvsg.core.errors import NewerStore, StoreError
from rvsg.core.records import canonical_json, text_id
from rvsg.generation.generator import Proposal
from rvsg.runs.attempt import Attempt, Measurement
from rvsg.scenario.brief import Brief, Feedback, Remembered
from rvsg.simulation.archive import MAGIC, PackedRun, arrays_of, run_from_json, run_to_json
from rvsg.simulation.kinematic import KinematicSimulator
from rvsg.simulation.run import Run
from rvsg.store import sqlite
from rvsg.store.sqlite import VERSION, SqliteLedger


def an_attempt(index: int = 0) -> tuple[Attempt, Run]:
    the_plan = plan()
    brief = Brief(mission=the_plan.mission, requirement=the_plan.requirement, seed=index)
    proposal = WalkGenerator().propose(brief, warehouse())
    assert proposal.scenario is not None
    run = KinematicSimulator().run(proposal.scenario, warehouse(), seed=3)
    return Attempt(campaign="test", index=index, strategy="study", brief=brief, proposal=proposal), run


def a_measured_attempt(index: int = 0) -> tuple[Attempt, Run]:
    attempt, run = an_attempt(index)
    values = {f"a metric with a long name, number {k}": k + index / 7 for k in range(80)}
    measured = Measurement(run_id=run.id, seed=run.seed, outcome=run.outcome.value, values=values)
    return attempt.replace(measurements=(measured,)), run


def same(a: Run, b: Run) -> bool:
    mine, theirs = arrays_of(a), arrays_of(b)
    return a.id == b.id and a.outcome is b.outcome and all(np.array_equal(mine[k], theirs[k]) for k in mine)


def altered(path: Path, *statements: tuple[str, tuple[object, ...]]) -> None:
    connection = sqlite3.connect(path)
    for statement, values in statements:
        connection.execute(statement, values)
    connection.commit()
    connection.close()


def test_a_run_as_json_comes_back_bit_for_bit() -> None:
    _, run = an_attempt()
    assert same(run_from_json(run_to_json(run)), run)


def test_an_attempt_is_kept_whole_or_not_at_all(tmp_path: Path) -> None:
    attempt, run = an_attempt()
    other, other_run = an_attempt(1)
    with SqliteLedger(tmp_path / "a.sqlite") as ledger:
        ledger.append(attempt, [PackedRun.of(run)])
        with pytest.raises(StoreError, check=coded("attempt-taken")):
            ledger.append(other.replace(index=0), [PackedRun.of(other_run)])
        assert list(ledger.attempts("test")) == [attempt]
        assert ledger.find(other_run.id) is None


def test_a_full_disk_ends_with_its_code_and_leaves_what_was_kept(tmp_path: Path) -> None:
    attempt, run = an_attempt()
    with SqliteLedger(tmp_path / "a.sqlite") as ledger:
        ledger.append(attempt, [])
        ledger._db.execute("PRAGMA max_page_count=1")  # no page more than there are
        with pytest.raises(StoreError) as refused:
            for seed in range(100):
                ledger.append(attempt.replace(index=seed + 1), [PackedRun.of(replace(run, seed=seed))])
        assert refused.value.code == "store-full" and "resume" in str(refused.value)
    with SqliteLedger(tmp_path / "a.sqlite") as ledger:
        assert [each.index for each in ledger.attempts("test")] == list(range(len(list(ledger.attempts("test")))))


@pytest.mark.parametrize("foreign", ["database", "text"])
def test_a_file_of_another_program_is_refused(tmp_path: Path, foreign: str) -> None:
    path = tmp_path / "a.sqlite"
    if foreign == "database":
        altered(path, ("CREATE TABLE songs (name TEXT)", ()))
    else:
        path.write_text("this is not a database, and it is long enough to be looked at " * 20)
    with pytest.raises(StoreError, check=coded("store-foreign")):
        SqliteLedger(path)


def test_an_absent_store_is_not_made_where_it_is_only_read(tmp_path: Path) -> None:
    with pytest.raises(StoreError, check=coded("store-absent")):
        SqliteLedger.existing(tmp_path / "a.sqlite")
    assert not (tmp_path / "a.sqlite").exists()


def truncated(path: Path) -> None:
    with path.open("r+b") as file:
        file.truncate(path.stat().st_size // 2)


def exchanged(path: Path, text: str) -> None:
    """Make a text, with an id that fits it, the record of every attempt."""
    record_id = text_id("attempt", text)
    insert = ("INSERT INTO records VALUES (?, ?)", (record_id, zlib.compress(text.encode())))
    altered(path, insert, ("UPDATE attempts SET id = ?", (record_id,)))


def after(statement: str, *values: object) -> Callable[[Path], None]:
    return lambda path: altered(path, (statement, values))


@pytest.mark.parametrize(
    "damage",
    [
        truncated,
        after("DROP TABLE attempts"),
        after("UPDATE campaigns SET settings = '{'"),
        after("UPDATE campaigns SET settings = CAST(x'7bb4' AS TEXT)"),
        after("UPDATE campaigns SET name = NULL"),
        after("UPDATE attempts SET id = 'attempt-0'"),
        after("UPDATE records SET packed = x'00'"),
        after("UPDATE records SET packed = 'text'"),
        after("UPDATE records SET packed = substr(packed, 1, length(packed) - 1)"),
        after("UPDATE records SET packed = ? WHERE id LIKE 'brief-%'", zlib.compress(b"[{}, {}]")),
        lambda path: exchanged(path, '[{}, {"a": "other-1"}]'),
        lambda path: exchanged(path, "1"),
        after("DELETE FROM records WHERE id LIKE 'scenario-%'"),
        after("DROP TABLE records"),
        after("DELETE FROM runs"),
        after("UPDATE runs SET arrays = substr(arrays, 1, length(arrays) - 1)"),
        after("UPDATE runs SET arrays = x'00'"),
        after("UPDATE runs SET header = '{}'"),
        after("CREATE TRIGGER extra BEFORE INSERT ON runs BEGIN SELECT missing(1); END"),
    ],
)
def test_a_store_with_a_part_lost_or_altered_is_called_damaged(tmp_path: Path, damage: Callable[[Path], None]) -> None:
    attempt, run = a_measured_attempt()
    path = tmp_path / "a.sqlite"
    with SqliteLedger(path) as ledger:
        ledger.begin("test", {"some": "settings"})
        ledger.append(attempt, [PackedRun.of(run)])
    damage(path)
    with pytest.raises(StoreError, check=coded("store-damaged")), SqliteLedger(path) as ledger:
        for name in ledger.campaigns():
            ledger.settings(name)
            list(ledger.attempts(name))
        ledger.run(run.id)


def test_an_attempt_stored_before_a_field_was_added_is_read_and_one_with_a_later_field_refused(tmp_path: Path) -> None:
    attempt, _ = an_attempt()
    older = attempt.model_dump(mode="json")
    del older["confirms"], older["brief"]["kind"]
    newer = attempt.model_dump(mode="json") | {"mood": "calm"}
    for name, record in (("older", older), ("newer", newer)):
        with SqliteLedger(tmp_path / name) as ledger:
            ledger.append(attempt, [])
        exchanged(tmp_path / name, canonical_json([record, {}]))
    with SqliteLedger(tmp_path / "older") as ledger:
        assert list(ledger.attempts("test")) == [attempt]
    with SqliteLedger(tmp_path / "newer") as ledger, pytest.raises(StoreError, check=coded("attempt-unreadable")):
        list(ledger.attempts("test"))


def test_other_settings_under_the_same_name_are_refused(tmp_path: Path) -> None:
    with SqliteLedger(tmp_path / "a.sqlite") as ledger:
        ledger.begin("test", {"seed": 1})
        ledger.begin("test", {"seed": 1})
        with pytest.raises(StoreError, check=coded("other-settings")):
            ledger.begin("test", {"seed": 2})
        assert ledger.settings("test") == {"seed": 1}
        assert ledger.campaigns() == ("test",)


def test_a_proposal_without_a_scenario_is_kept(tmp_path: Path) -> None:
    attempt, _ = an_attempt()
    empty = attempt.replace(proposal=Proposal(generator="walk", scenario=None))
    with SqliteLedger(tmp_path / "a.sqlite") as ledger:
        ledger.append(empty, [])
        assert list(ledger.attempts("test")) == [empty]


def test_a_campaign_is_forgotten_only_while_it_made_no_attempt(tmp_path: Path) -> None:
    attempt, run = an_attempt()
    with SqliteLedger(tmp_path / "a.sqlite") as ledger:
        ledger.begin(attempt.campaign, {"seed": 1})
        assert ledger.forget_empty(attempt.campaign)
        assert ledger.campaigns() == ()
        ledger.begin(attempt.campaign, {"seed": 2})
        ledger.append(attempt, [PackedRun.of(run)])
        assert not ledger.forget_empty(attempt.campaign)
        assert ledger.settings(attempt.campaign) == {"seed": 2}


def test_a_new_store_opened_by_several_at_once_is_made_once(tmp_path: Path) -> None:
    path = tmp_path / "a.sqlite"
    attempt, run = an_attempt()
    together = threading.Barrier(6)

    def opened(_: int) -> list[Attempt]:
        together.wait()
        with SqliteLedger(path) as ledger:
            return list(ledger.attempts("test"))

    with ThreadPoolExecutor(6) as pool:
        assert list(pool.map(opened, range(6))) == [[]] * 6
    with SqliteLedger(path) as ledger:
        ledger.append(attempt, [PackedRun.of(run)])


def test_a_store_whose_making_was_broken_off_is_made_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.sqlite"
    monkeypatch.setattr(sqlite, "SCHEMA", (*sqlite.SCHEMA, "CREATE nonsense"))
    with pytest.raises(StoreError):
        SqliteLedger(path)
    monkeypatch.undo()
    with SqliteLedger(path) as ledger:
        assert ledger.campaigns() == ()


def test_a_single_number_changed_in_the_arrays_of_a_run_is_noticed(tmp_path: Path) -> None:
    _, run = an_attempt()
    path = tmp_path / "a.sqlite"
    with SqliteLedger(path) as ledger:
        ledger.keep(PackedRun.of(run))
    run.trajectory.x[3] += 1e-9
    altered(path, ("UPDATE runs SET arrays = ?", (PackedRun.of(run).data,)))  # whole, and of the right shape
    with pytest.raises(StoreError, check=coded("store-damaged")) as refused, SqliteLedger(path) as ledger:
        ledger.find(run.id)
    assert str(path) in str(refused.value) and run.id in str(refused.value)  # which run of which file is lost


@pytest.mark.parametrize("version", [1, VERSION - 1, VERSION + 1])
def test_a_store_of_another_version_is_refused_and_left_alone(tmp_path: Path, version: int) -> None:
    path = tmp_path / "a.sqlite"
    SqliteLedger(path).close()
    altered(path, (f"PRAGMA user_version={version}", ()))
    before = path.read_bytes()
    for opened in (SqliteLedger, SqliteLedger.existing):
        with pytest.raises(StoreError) as refused:
            opened(path)
        assert refused.value.code == "store-earlier" or (version > VERSION and isinstance(refused.value, NewerStore))
    assert path.read_bytes() == before


def test_a_store_that_may_not_be_written_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    attempt, run = an_attempt()
    path = tmp_path / "a store.sqlite"
    with SqliteLedger(path) as ledger:
        ledger.append(attempt, [PackedRun.of(run)])
    before = path.read_bytes()
    monkeypatch.setattr("os.access", lambda *_: False)
    with SqliteLedger.existing(path) as ledger:
        assert list(ledger.attempts("test")) == [attempt] and same(ledger.run(run.id), run)
        with pytest.raises(StoreError, check=coded("store-readonly")):
            ledger.keep(PackedRun.of(an_attempt(1)[1]))
    assert path.read_bytes() == before and [p.name for p in tmp_path.iterdir()] == [path.name]


def test_a_store_that_may_not_be_written_is_read_with_what_a_killed_campaign_left_in_its_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = an_attempt()[0], an_attempt(1)[0]
    path, copy = tmp_path / "a.sqlite", tmp_path / "copy"
    with SqliteLedger(path) as ledger:
        ledger.append(first, [])
    copy.mkdir()
    with SqliteLedger(path) as ledger:
        ledger.append(second, [])
        for file in tmp_path.glob("a.sqlite*"):  # as a kill would leave them
            shutil.copy(file, copy / file.name)
    assert (copy / "a.sqlite-wal").stat().st_size
    monkeypatch.setattr("os.access", lambda *_: False)
    with SqliteLedger.existing(copy / "a.sqlite") as ledger:
        assert list(ledger.attempts("test")) == [first, second]


def test_damage_anywhere_in_the_file_is_told_when_it_is_opened(tmp_path: Path) -> None:
    attempt, run = an_attempt()
    path = tmp_path / "a.sqlite"
    with SqliteLedger(path) as ledger:
        ledger.begin("test", {"some": "settings"})
        ledger.append(attempt, [PackedRun.of(run)])
    whole = path.read_bytes()
    arrays = whole.index(MAGIC)
    for begin, length in ((arrays + 50, 8), (len(whole) // 2, 9000)):
        path.write_bytes(whole[:begin] + b"\xa5" * length + whole[begin + length :])
        for opened in (SqliteLedger, SqliteLedger.existing):
            with pytest.raises(StoreError, check=coded("store-damaged")):
                opened(path)


def test_what_attempts_repeat_is_stored_once_and_shared_where_it_is_read(tmp_path: Path) -> None:
    path = tmp_path / "a.sqlite"
    attempt = a_measured_attempt()[0]
    scenario = attempt.proposal.scenario
    assert scenario is not None
    feedback = Feedback(scenario=scenario, objectives=(1.0,), mean=1.0, interval=(1.0, 1.0))
    memory = Remembered(description="", tasks={}, mean=1.0, interval=(1.0, 1.0), scenario=scenario)
    told = attempt.brief.replace(feedback=feedback, memory=(memory, memory))
    rehearsed = attempt.proposal.replace(rehearsals=((scenario, 2.0),), extra={"brief": {"a.b": ["proposal-1"]}})
    attempts = [attempt, attempt.replace(index=1, brief=told, proposal=rehearsed), attempt.replace(index=2, brief=told)]
    with SqliteLedger(path) as ledger:
        for each in attempts:
            ledger.append(each, [])
            ledger.append(each.replace(campaign="Zweite Kampagne: 人"), [])
        stored = list(ledger.attempts("test"))
        ids = [row[0].partition("-")[0] for row in ledger._rows("SELECT id FROM records")]
    assert stored == attempts and [each.id for each in stored] == [each.id for each in attempts]
    assert Counter(ids) == {"attempt": 6, "brief": 2, "proposal": 2, "scenario": 1, "mission": 1}
    first, second, third = stored
    assert second.brief is third.brief and second.brief.memory[1].scenario is first.proposal.scenario
    altered(path, ("DELETE FROM attempts WHERE position = 1", ()))
    with SqliteLedger(path) as ledger:
        assert list(ledger.attempts("test")) == [attempts[0], attempts[2]]
