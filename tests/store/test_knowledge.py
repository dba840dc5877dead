"""The knowledge base in SQLite and in a real PostgreSQL server: nothing lost, nothing twice."""

from __future__ import annotations

import os
import pwd
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import sqlalchemy as sa
from tests.store.knowledge_writer import entry

from rvsg.core.errors import InputError, StoreError
from rvsg.store.knowledge_base import KnowledgeBase

WRITER = Path(__file__).with_name("knowledge_writer.py")
COUNT = 60


@pytest.fixture(scope="module")
def postgresql() -> Iterator[str]:
    """Start a server of Debian's package on a socket of its own, as another user where this one is root."""
    missing = [tool for tool in ("initdb", "postgres") if shutil.which(tool) is None]
    if missing:
        pytest.skip(f"no PostgreSQL server here: {', '.join(missing)} not found (Debian's package `postgresql`)")
    pytest.importorskip("psycopg")
    folder = Path(tempfile.mkdtemp(prefix="rvsg-pg-", dir="/tmp"))
    how: dict[str, object] = {}
    if os.geteuid() == 0:  # PostgreSQL refuses to run as root
        known = {user.pw_name for user in pwd.getpwall()}
        user = "postgres" if "postgres" in known else "nobody"
        os.chown(folder, pwd.getpwnam(user).pw_uid, -1)
        how = {"user": user, "extra_groups": []}
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": folder, **how}
    data = folder / "data"
    subprocess.run(["initdb", "-D", data, "-U", "rvsg", "-A", "trust", "-N"], check=True, timeout=300, **quiet)
    server = subprocess.Popen(["postgres", "-D", data, "-k", folder, "-c", "listen_addresses="], **quiet)
    url = f"postgresql://rvsg@/postgres?host={folder}"
    try:
        for _ in range(3000):
            try:
                KnowledgeBase(url).close()
                break
            except StoreError:
                time.sleep(0.1)
        yield url
    finally:
        server.send_signal(signal.SIGINT)
        server.wait(300)
        shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture(params=["sqlite", pytest.param("postgresql", marks=pytest.mark.service)])
def where(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """Return the address of an empty knowledge base."""
    if request.param == "sqlite":
        return str(tmp_path / "knowledge.sqlite")
    url: str = request.getfixturevalue("postgresql")
    engine = sa.create_engine(sa.make_url(url).set(drivername="postgresql+psycopg"))
    with engine.begin() as connection:
        for table in ("rvsg_knowledge", "rvsg_knowledge_origins", "rvsg_knowledge_embeddings"):
            connection.execute(sa.text(f"DROP TABLE IF EXISTS {table}"))
    engine.dispose()
    return url


def test_what_was_added_is_there_once_with_every_origin(where: str) -> None:
    with KnowledgeBase(where) as base:
        assert base.add([entry(1), entry(2), entry(1)], origin="a") == 2
        assert base.add([entry(2), entry(3)], origin="b") == 1
        assert base.add([]) == 0
    with KnowledgeBase(where) as base:
        assert sorted(each.description for each in base.entries()) == ["plan 1", "plan 2", "plan 3"]
        assert base.origins(entry(2).id) == ("a", "b")
        assert base.counts() == {("w", "rejected"): 3}
        assert base.entries(route="route_2") == [] and len(base.entries(world="w", kind="rejected")) == 3


def test_vectors_are_kept(where: str) -> None:
    with KnowledgeBase(where) as base:
        base.keep_vectors({"a": np.arange(4, dtype=np.float32)})
        base.keep_vectors({"a": np.zeros(4, dtype=np.float32)})
        assert base.vectors(["a", "b"])["a"].tolist() == [0.0, 1.0, 2.0, 3.0]


def test_several_that_open_the_same_new_file_at_once_all_open_it(tmp_path: Path) -> None:
    together = threading.Barrier(8)

    def add(path: Path) -> int:
        together.wait(60)
        with KnowledgeBase(str(path)) as base:
            return base.add([entry(1)])

    with ThreadPoolExecutor(8) as pool:
        for round_ in range(10):
            assert sum(pool.map(add, [tmp_path / f"{round_}.sqlite"] * 8)) == 1


@pytest.mark.slow
def test_four_writers_killed_at_random_lose_nothing_and_add_nothing_twice(where: str, tmp_path: Path) -> None:
    rng = random.Random(5)
    steps = (1, 7, 11, 13)  # without a common divisor with COUNT: each writer adds all entries, in an order of its own
    notes = [tmp_path / f"acknowledged-{k}" for k in range(4)]

    def start(k: int) -> subprocess.Popen[bytes]:
        arguments = [where, str(notes[k]), str(k * 15), str(steps[k]), str(COUNT)]
        return subprocess.Popen([sys.executable, str(WRITER), *arguments])

    writers = {k: start(k) for k in range(4)}
    killed, kills, written = [], 12, rng.randint(1, 15)
    deadline = time.monotonic() + 300
    try:
        while writers:
            assert time.monotonic() < deadline
            time.sleep(0.02)
            for k, writer in list(writers.items()):
                if (code := writer.poll()) is not None:
                    assert code in (0, -signal.SIGKILL)
                    if code == 0:
                        del writers[k]
                    else:
                        writers[k] = start(k)
            alive = [k for k, writer in writers.items() if writer.poll() is None]
            acknowledged = [line for each in notes if each.exists() for line in each.read_text().splitlines()]
            if alive and len(killed) < kills and len(acknowledged) >= written:
                written += rng.randint(1, 15)  # a kill follows what was done, not the clock
                k = rng.choice(alive)
                writers[k].kill()
                writers[k].wait()
                killed.append(k)
                writers[k] = start(k)
    finally:
        for writer in writers.values():
            writer.kill()
            writer.wait()
    assert len(killed) >= 4
    numbers = {int(line) for each in notes for line in each.read_text().splitlines()}
    with KnowledgeBase(where) as base:
        kept = [each.id for each in base.entries()]
        origins = base.origins(entry(0).id)
    assert len(kept) == len(set(kept)) == COUNT
    assert {entry(number).id for number in numbers} <= set(kept)
    assert origins == tuple(f"writer {k * 15}" for k in (0, 1, 2, 3))


def test_an_altered_entry_is_told(tmp_path: Path) -> None:
    path = tmp_path / "k.sqlite"
    with KnowledgeBase(str(path)) as base:
        base.add([entry(1)])
    engine = sa.create_engine(f"sqlite:///{path}")
    with engine.begin() as connection:
        connection.execute(sa.text("UPDATE rvsg_knowledge SET record = replace(record, 'plan 1', 'plan 9')"))
    engine.dispose()
    with KnowledgeBase(str(path)) as base, pytest.raises(StoreError):
        base.entries()


@pytest.mark.parametrize("address", ["mysql://host/db", "nonsense://", "oracle+x://h"])
def test_an_address_that_is_none_is_refused(address: str) -> None:
    with pytest.raises(InputError):
        KnowledgeBase(address)


def test_a_database_that_is_not_there_or_of_another_kind_is_one_message_without_its_password(tmp_path: Path) -> None:
    pytest.importorskip("psycopg")
    with pytest.raises(StoreError) as raised:
        KnowledgeBase(f"postgresql://me:secret@/db?host={tmp_path}")
    assert "secret" not in str(raised.value)
    (tmp_path / "notes.txt").write_text("no database" * 100)
    with pytest.raises(StoreError):
        KnowledgeBase(str(tmp_path / "notes.txt"))
