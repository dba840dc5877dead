"""Stored runs: what is lost, what is damaged, and what is out of range."""

from __future__ import annotations

import contextlib
import json
import lzma
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from tests.campaign.parts import warehouse
from tests.conformance.test_campaign_parts import answered

from rvsg.core import plugins
from rvsg.core.errors import InputError
from rvsg.evaluation.metrics import measure
from rvsg.simulation.archive import (
    DECIMALS,
    LARGEST,
    MAGIC,
    PackedRun,
    arrays_of,
    decode,
    encode,
    rounded,
    rounded_arrays,
    run_from_value,
    run_to_json,
)
from rvsg.simulation.kinematic import KinematicSimulator

A_RUN = KinematicSimulator().run(answered(0)[2], warehouse(), seed=1)
ARCHIVE = PackedRun.of(rounded(A_RUN)).data
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


def test_what_is_measured_is_what_is_stored() -> None:
    run = rounded(A_RUN)
    stored = PackedRun.of(run).unpack()
    assert all(np.array_equal(array, arrays_of(stored)[name]) for name, array in arrays_of(run).items())
    assert measure(stored, world=warehouse()) == measure(run, world=warehouse())


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.exhaustive)])
def test_a_stored_run_is_small_and_no_metric_sees_the_rounding(seed: int) -> None:
    exact = plugins.make("simulator", "embedded", {}).run(answered(seed)[2], warehouse(), seed=seed)
    run = rounded(exact)
    assert len(PackedRun.of(run).data) < 9000
    before, after = measure(exact, world=warehouse()), measure(run, world=warehouse())
    for name, value in before.items():
        assert (value is None) == (after[name] is None), name
        if value is not None:
            assert after[name] == pytest.approx(value, rel=1e-3, abs=1e-3), name


@pytest.mark.parametrize("value", [1e308, -1e308, 2 * LARGEST])
@pytest.mark.parametrize("name", json.loads(run_to_json(A_RUN))["arrays"])
def test_an_array_with_a_number_out_of_range_is_refused(name: str, value: float) -> None:
    given = json.loads(run_to_json(A_RUN))
    array = given["arrays"][name] or [0.0]
    place = array[-1] if isinstance(array[-1], list) else array
    place[-1] = value
    with pytest.raises(InputError, match=name):
        run_from_value(given | {"arrays": given["arrays"] | {name: array}})


OUT_OF_RANGE = [
    *(("seed", -1), ("recoveries", -1), ("clock_ratio", 1e308), ("clock_ratio", 0.0), ("robot_radius_m", 1e308)),
    *(("human_radius_m", (-1.0, 0.3)), ("goal", (1e308, 0.0, 0.0)), ("time_limit_s", 1e308), ("time_limit_s", -1.0)),
    *(("robot_latency_s", -1.0), ("robot_deceleration_m_s2", 0.0), ("robot_outline", ((1e308, 0.0),))),
]


@pytest.mark.parametrize(("field", "value"), OUT_OF_RANGE)
def test_a_field_out_of_range_is_refused_from_a_file_and_from_a_simulator(field: str, value: object) -> None:
    given = json.loads(run_to_json(A_RUN))
    with pytest.raises(InputError, match=field):
        run_from_value(given | {field: value})
    with pytest.raises(InputError, match=field):
        PackedRun.of(replace(A_RUN, **{field: value}))  # type: ignore[arg-type]
