"""Seeds and random streams, derived from one stored seed by name and index, never by the order of events."""

from __future__ import annotations

import hashlib
from collections.abc import Collection

import numpy as np


def seed_for(campaign_seed: int, purpose: str, *index: int) -> int:
    """Return the seed (0 to 2**32 - 1) for one purpose and index, e.g. `seed_for(7, "search", attempt, repeat)`.

    Other purposes, other indices and other campaign seeds give independent seeds; so the same scenario meets the
    same noise whether runs are made one after the other, in parallel, or after a resume.
    """
    name = int.from_bytes(hashlib.sha256(purpose.encode()).digest()[:4], "little")
    return int(np.random.SeedSequence(campaign_seed, spawn_key=(name, *index)).generate_state(1)[0])


def fresh_seeds(campaign_seed: int, purpose: str, count: int, *, used: Collection[int]) -> tuple[int, ...]:
    """`count` different seeds for a purpose, none of them in `used`."""
    seeds: dict[int, None] = {}
    taken = set(used)
    index = 0
    while len(seeds) < count:
        seed = seed_for(campaign_seed, purpose, index)
        if seed not in taken:
            seeds[seed] = None
        index += 1
    return tuple(seeds)


def stream(seed: int, name: str) -> np.random.Generator:
    """Return the random numbers of one source of noise in one run.

    Streams of different names are independent, so switching one source off does not change another.
    """
    digest = hashlib.sha256(name.encode()).digest()
    key = tuple(int.from_bytes(digest[i : i + 4], "little") for i in range(0, 16, 4))
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed, spawn_key=key)))
