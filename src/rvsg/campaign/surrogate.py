"""A linear model of what was measured, over what the forecast says: it ranks configurations before they are run.

How much a forecast says differs between requirements and routes, so its weights are learnt in the campaign. Only
differences between a configuration and the one it was changed from are predicted. Ridge regression keeps the weights
near zero where the runs do not support them, and then every change looks as good as any other.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rvsg.campaign.racing import Candidate

Floats = NDArray[np.float64]

FEWEST = 8
"""Candidates needed for a model."""
RIDGE = 3.0
"""Strength of the penalty, in candidates; features have unit variance."""


class Surrogate:
    """Predicts the difference in badness between two configurations from their features."""

    def __init__(self, candidates: Sequence[Candidate], features: Floats) -> None:
        """Fit the model to candidates with runs; `features` has one row for each."""
        count = features.shape[1]
        self.weights = np.zeros(count)
        if len(candidates) < FEWEST:
            return
        spread = features.std(axis=0)
        scale = np.where(spread > 1e-9, spread, np.inf)
        rows = (features - features.mean(axis=0)) / scale
        values = np.array([candidate.estimate for candidate in candidates])
        values = values - values.mean()
        self.weights = np.linalg.solve(rows.T @ rows + RIDGE * np.eye(count), rows.T @ values) / scale

    def differences(self, features: Floats, origin: Floats) -> Floats:
        """Return how much worse for the robot each row is expected to be than `origin`."""
        return np.asarray((features - origin) @ self.weights)
