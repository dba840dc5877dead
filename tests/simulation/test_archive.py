"""What is lost when a run is stored, and what is not."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from tests.campaign.parts import WalkGenerator, plan, warehouse

from rvsg.core import plugins
from rvsg.evaluation.metrics import measure
from rvsg.scenario.brief import Brief
from rvsg.scenario.scenario import Scenario
from rvsg.simulation.archive import PackedRun, arrays_of, rounded
from rvsg.simulation.kinematic import KinematicSimulator
from rvsg.simulation.quantised import DECIMALS, decode, encode, rounded_array


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
    for given_arrays in (arrays, {name: rounded_array(name, array) for name, array in arrays.items()}):
        back, found = decode(encode(text.encode(errors="replace").decode(), given_arrays))
        assert back == text.encode(errors="replace").decode()
        assert list(found) == list(given_arrays)
        for name, array in given_arrays.items():
            assert found[name].shape == array.shape
            assert np.array_equal(found[name], array, equal_nan=True)


@given(names, hnp.arrays(np.float64, 5, elements=st.floats(-1e6, 1e6)))
def test_rounding_is_small_and_done_once(name: str, array: np.ndarray) -> None:
    once = rounded_array(name, array)
    assert np.array_equal(rounded_array(name, once), once)
    assert np.abs(once - array).max() <= 0.5001e-4


@given(st.binary(max_size=200) | st.binary(max_size=200).map(lambda data: b"RVQ1" + data))
def test_bytes_that_are_no_archive_are_a_value_error(data: bytes) -> None:
    with pytest.raises(ValueError):
        decode(data)


@given(st.integers(4, 3000), st.integers(1, 255))
def test_a_damaged_archive_is_a_value_error_or_still_made_of_arrays(at: int, change: int) -> None:
    data = bytearray(ARCHIVE)
    data[at % len(data)] ^= change
    try:
        decode(bytes(data))
    except ValueError:
        return


ARCHIVE = PackedRun.of(rounded(KinematicSimulator().run(scenario(), warehouse(), seed=1))).data


def test_what_is_measured_is_what_is_stored() -> None:
    run = rounded(KinematicSimulator().run(scenario(), warehouse(), seed=1))
    stored = PackedRun.of(run).unpack()
    assert all(np.array_equal(array, arrays_of(stored)[name]) for name, array in arrays_of(run).items())
    assert measure(stored, world=warehouse()) == measure(run, world=warehouse())


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1])
def test_a_stored_run_is_small_and_no_metric_sees_the_rounding(seed: int) -> None:
    exact = plugins.make("simulator", "embedded", {}).run(scenario(seed), warehouse(), seed=seed)
    run = rounded(exact)
    assert len(PackedRun.of(run).data) < 6000
    before, after = measure(exact, world=warehouse()), measure(run, world=warehouse())
    for name, value in before.items():
        assert (value is None) == (after[name] is None), name
        if value is not None:
            assert after[name] == pytest.approx(value, rel=1e-3, abs=1e-3), name
