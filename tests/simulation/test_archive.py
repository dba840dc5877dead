"""What is lost when a run is stored, and what is not."""

from __future__ import annotations

import contextlib
import gzip
import sqlite3
import tempfile
import zlib
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from tests.campaign.parts import WalkGenerator, plan, warehouse

from rvsg.core import plugins
from rvsg.evaluation.metrics.registry import measure
from rvsg.scenario.brief import Brief
from rvsg.scenario.scenario import Scenario
from rvsg.simulation import byte_planes
from rvsg.simulation.archive import PackedRun, arrays_of, rounded
from rvsg.simulation.kinematic import KinematicSimulator
from rvsg.simulation.quantised import DECIMALS, decode, encode, rounded_arrays


def scenario(seed: int = 0) -> Scenario:
    brief = Brief(mission=plan().mission, requirement=plan().requirement, seed=seed)
    found = WalkGenerator().propose(brief, warehouse()).scenario
    assert found is not None
    return found


names = st.sampled_from([*DECIMALS, "trajectory.x", "unknown"])
shapes = hnp.array_shapes(min_dims=1, max_dims=2, min_side=0, max_side=9)
values = st.floats(-1e7, 1e7) | st.floats() | st.sampled_from([0.0, -0.0, 1e-4, -1e-4, 0.05, 2.0**60])


@given(st.text(), st.dictionaries(names, hnp.arrays(np.float64, shapes, elements=values)))
def test_arrays_come_back_exactly_rounded_or_not(text: str, arrays: dict[str, np.ndarray]) -> None:
    for given_arrays in (arrays, rounded_arrays(arrays)):
        back, found = decode(encode(text.encode(errors="replace").decode(), given_arrays))
        assert back == text.encode(errors="replace").decode()
        assert list(found) == list(given_arrays)
        for name, array in given_arrays.items():
            assert found[name].shape == array.shape
            assert np.array_equal(found[name], array, equal_nan=True)


@given(names, hnp.arrays(np.float64, 5, elements=st.floats(-1e6, 1e6)))
def test_rounding_is_small_and_done_once(name: str, array: np.ndarray) -> None:
    once = rounded_arrays({name: array})[name]
    assert np.array_equal(rounded_arrays({name: once})[name], once)
    assert np.abs(once - array).max() <= 0.5001e-4


starts = st.sampled_from([b"", b"RVQ1", b"RVQ2", b"RVQ2\0\0\0\0"])


@given(st.builds(lambda start, rest: start + rest, starts, st.binary(max_size=200)))
def test_bytes_that_are_no_archive_are_a_value_error(data: bytes) -> None:
    with pytest.raises(ValueError):
        decode(data)


@given(st.integers(0, 3000), st.integers(1, 255))
def test_a_damaged_archive_is_a_value_error(at: int, change: int) -> None:
    data = bytearray(ARCHIVE)
    data[at % len(data)] ^= change
    with pytest.raises(ValueError):
        decode(bytes(data))


@given(st.integers(0, 3000), st.integers(1, 255))
def test_damage_that_the_check_sum_hides_is_a_value_error_or_arrays(at: int, change: int) -> None:
    body = bytearray(ARCHIVE[8:])
    body[at % len(body)] ^= change
    with contextlib.suppress(ValueError):
        decode(ARCHIVE[:4] + zlib.crc32(body).to_bytes(4, "little") + body)


@given(st.integers(0, 3000), st.integers(1, 255))
def test_a_damaged_archive_of_an_older_store_is_a_value_error_or_arrays(at: int, change: int) -> None:
    data = bytearray(older_archive())
    data[4 + at % (len(data) - 4)] ^= change
    with contextlib.suppress(ValueError):
        decode(bytes(data))


@cache
def older_archive() -> bytes:
    store = Path(__file__).parents[1] / "store" / "version_4.sqlite.gz"
    with tempfile.NamedTemporaryFile() as file:
        Path(file.name).write_bytes(gzip.decompress(store.read_bytes()))
        with contextlib.closing(sqlite3.connect(file.name)) as connection:
            (archive,) = connection.execute("SELECT arrays FROM runs").fetchone()
    assert isinstance(archive, bytes) and archive.startswith(b"RVQ1")
    return archive


def test_a_run_of_the_default_simulator_takes_a_third_less_than_before() -> None:
    text, arrays = decode(older_archive())
    packed = encode(text, arrays)
    assert len(packed) < 0.68 * len(older_archive())
    back, found = decode(packed)
    assert back == text and all(np.array_equal(array, found[name]) for name, array in arrays.items())


steps = st.integers(-(2**58), 2**58) | st.integers(-3, 3) | st.sampled_from([0, 1, -1, 2**58, -(2**58)])
tables = hnp.arrays(np.int64, hnp.array_shapes(min_dims=2, max_dims=2, min_side=1, max_side=8), elements=steps)


@given(st.lists(tables, max_size=4))
def test_coded_integers_come_back(given: list[np.ndarray]) -> None:
    found = byte_planes.decode(byte_planes.encode(given), [(len(table), table.shape[1]) for table in given], 10**6)
    assert len(found) == len(given) and all(map(np.array_equal, found, given))


ARCHIVE = PackedRun.of(rounded(KinematicSimulator().run(scenario(), warehouse(), seed=1))).data


def test_what_is_measured_is_what_is_stored() -> None:
    run = rounded(KinematicSimulator().run(scenario(), warehouse(), seed=1))
    stored = PackedRun.of(run).unpack()
    assert all(np.array_equal(array, arrays_of(stored)[name]) for name, array in arrays_of(run).items())
    assert measure(stored, world=warehouse()) == measure(run, world=warehouse())


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.exhaustive)])
def test_a_stored_run_is_small_and_no_metric_sees_the_rounding(seed: int) -> None:
    exact = plugins.make("simulator", "embedded", {}).run(scenario(seed), warehouse(), seed=seed)
    run = rounded(exact)
    assert len(PackedRun.of(run).data) < 4500
    before, after = measure(exact, world=warehouse()), measure(run, world=warehouse())
    for name, value in before.items():
        assert (value is None) == (after[name] is None), name
        if value is not None:
            assert after[name] == pytest.approx(value, rel=1e-3, abs=1e-3), name
