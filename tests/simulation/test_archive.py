"""What is lost when a run is stored, and what is not."""

from __future__ import annotations

import contextlib
import lzma

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
from rvsg.simulation.archive import DECIMALS, MAGIC, PackedRun, arrays_of, decode, encode, rounded, rounded_arrays
from rvsg.simulation.kinematic import KinematicSimulator


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


starts = st.sampled_from([b"", b"RVQ1", b"RVQ2", MAGIC, MAGIC + lzma.compress(b"")[:12]])


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


@given(st.integers(0, 20_000), st.integers(1, 255))
def test_damage_that_the_check_sum_hides_is_a_value_error_or_arrays(at: int, change: int) -> None:
    body = bytearray(lzma.decompress(ARCHIVE[len(MAGIC) :]))
    body[at % len(body)] ^= change
    with contextlib.suppress(ValueError):
        decode(MAGIC + lzma.compress(body, preset=0))


def test_an_archive_that_unpacks_to_more_than_any_run_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rvsg.simulation.archive.MOST_BYTES", 100_000)
    with pytest.raises(ValueError, match="too large"):
        decode(MAGIC + lzma.compress(bytes(200_000), preset=0))


def test_an_archive_of_an_earlier_version_is_named() -> None:
    with pytest.raises(ValueError, match="an earlier version of RVSG"):
        decode(b"RVQ2" + ARCHIVE[4:])


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
    assert len(PackedRun.of(run).data) < 9000
    before, after = measure(exact, world=warehouse()), measure(run, world=warehouse())
    for name, value in before.items():
        assert (value is None) == (after[name] is None), name
        if value is not None:
            assert after[name] == pytest.approx(value, rel=1e-3, abs=1e-3), name
