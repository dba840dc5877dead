"""One way from a brief to random numbers, so that an equal brief gives an equal proposal."""

from __future__ import annotations

import zlib

import numpy as np

from rvsg.scenario.brief import Brief


def rng_of(brief: Brief, name: str) -> np.random.Generator:
    """The random numbers of a generator for a brief: of its seed, its place in the campaign and the name."""
    key = (zlib.crc32(name.encode()), brief.scenario_index, brief.configuration_index)
    return np.random.default_rng(np.random.SeedSequence(entropy=brief.seed, spawn_key=key))
