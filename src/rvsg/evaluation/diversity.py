"""Diversity of a set of scenarios: of their descriptions (sdd), their tasks (htd) and their runs (ssd).

Each is a mean over all unordered pairs, and None if there are fewer than two members. Source: the RVSG study.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations, product

import numpy as np
from numpy.typing import NDArray

from rvsg.evaluation.sentences import embed
from rvsg.simulation.run import Run

TaskLists = Sequence[Sequence[str]]


def description_diversity(descriptions: Sequence[str]) -> float | None:
    """Return sdd: 1 - mean over pairs of the cosine similarity of the embeddings (all-MiniLM-L6-v2)."""
    if len(descriptions) < 2:
        return None
    vectors = embed(descriptions).astype(np.float64)
    similarity = vectors @ vectors.T
    upper = np.triu_indices(len(vectors), 1)
    return 1.0 - float(similarity[upper].mean())


def task_diversity(scenarios: Sequence[TaskLists]) -> float | None:
    """Return htd: the mean over pairs (i, j) of the mean Levenshtein distance of human a's tasks in i to b's in j.

    A member is the task lists of its humans; a token is a whole task name. With two humans the inner mean is over
    four distances. Members without humans are left out; None with fewer than two members.
    """
    from rapidfuzz.distance import Levenshtein

    peopled = [scenario for scenario in scenarios if len(scenario)]
    if len(peopled) < 2:
        return None
    means = []
    for first, second in combinations(peopled, 2):
        pairs = list(product(first, second))
        means.append(sum(Levenshtein.distance(list(a), list(b)) for a, b in pairs) / len(pairs))
    return float(np.mean(means))


def positions(run: Run) -> NDArray[np.float64]:
    """Return (N, 2 + 2 H): x, y of the robot, then of each human, over the logged rows (2 Hz)."""
    log = run.log
    columns = [log.x, log.y]
    for human in range(log.human_x.shape[1]):
        columns += [log.human_x[:, human], log.human_y[:, human]]
    return np.ascontiguousarray(np.stack(columns, axis=1), dtype=np.float64)


def warping_distance(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    """Return the exact dynamic time warping distance of two (N, D) series.

    It is the square root of the smallest sum of squared Euclidean distances along a warping path.
    """
    from dtaidistance import dtw_ndim

    return float(dtw_ndim.distance(a, b, use_c=True))


def simulation_diversity(series: Sequence[NDArray[np.float64]]) -> float | None:
    """Return ssd: the mean over pairs of the warping distance of their `positions`.

    Series with different numbers of people cannot be compared; such pairs are left out. None without any pair.
    """
    distances = [warping_distance(a, b) for a, b in combinations(series, 2) if a.shape[1] == b.shape[1]]
    return float(np.mean(distances)) if distances else None
