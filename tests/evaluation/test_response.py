"""Response surfaces of runs whose violation probability is known."""

from __future__ import annotations

import numpy as np
import pytest

from rvsg.evaluation.statistics import fit_surface, sensitivities

RNG = np.random.default_rng


def logistic(z: np.ndarray) -> np.ndarray:
    return 1.0 / (1.0 + np.exp(-z))


def test_a_known_surface_is_found_with_its_boundary() -> None:
    rng = RNG(1)
    shares = rng.random((400, 2))
    truth = logistic(12.0 * (shares[:, 0] - 0.6))
    surface = fit_surface(shares, rng.random(400) < truth)
    assert surface.degree >= 1
    assert np.sqrt(np.mean((surface.probability(shares) - truth) ** 2)) < 0.06
    along = np.linspace(0, 1, 201)
    crossing = along[np.argmax(surface.probability(np.stack([along, np.full(201, 0.5)], axis=1)) >= 0.5)]
    assert crossing == pytest.approx(0.6, abs=0.06)


def test_a_region_in_the_middle_needs_squares() -> None:
    rng = RNG(2)
    shares = rng.random((300, 1))
    truth = logistic(6.0 - 90.0 * (shares[:, 0] - 0.5) ** 2)
    surface = fit_surface(shares, rng.random(300) < truth)
    assert surface.degree == 2
    low, middle, high = surface.probability(np.array([[0.02], [0.5], [0.98]]))
    assert low < 0.1 < 0.9 < middle and high < 0.1


def test_runs_without_dependence_mostly_give_a_flat_surface() -> None:
    """AICc takes one parameter too many in about 16 of 100 cases by its construction (chi-squared 1 above 2)."""
    rng = RNG(3)
    degrees = [fit_surface(rng.random((80, 1)), rng.random(80) < 0.4).degree for _ in range(100)]
    assert degrees.count(0) >= 70


@pytest.mark.parametrize("violated", [False, True])
def test_runs_that_all_agree_stay_finite(violated: bool) -> None:
    shares = RNG(4).random((30, 2))
    surface = fit_surface(shares, [violated] * 30)
    p = surface.probability(shares)
    low, high = surface.interval(shares)
    assert np.isfinite([p, low, high]).all()
    assert ((p > 0.9) if violated else (p < 0.1)).all()


def test_separated_runs_stay_finite() -> None:
    shares = np.linspace(0, 1, 40)[:, None]
    surface = fit_surface(shares, list(shares[:, 0] > 0.5))
    assert surface.degree >= 1 and np.isfinite(surface.coefficients).all()


def test_the_interval_covers_the_truth() -> None:
    """95 % intervals at the middle of the range: at least 90 of 100 cover where the surface is of the true form."""
    rng = RNG(5)
    covered = 0
    for _ in range(100):
        shares = rng.random((120, 1))
        surface = fit_surface(shares, rng.random(120) < logistic(4.0 * (shares[:, 0] - 0.5)))
        low, high = surface.interval(np.array([[0.75]]))
        covered += bool(low[0] <= logistic(np.array(1.0)) <= high[0])
    assert covered >= 90


def test_the_parameter_that_matters_is_told_from_the_one_that_does_not() -> None:
    rng = RNG(6)
    shares = rng.random((200, 2))
    badness = 3.0 * shares[:, 0] + 0.3 * rng.standard_normal(200)
    surface = fit_surface(shares, list(badness > 1.5))
    first, second = sensitivities(surface, ["speed", "delay"], shares, list(badness), seed=0)
    assert first.share > 0.9 and second.share < 0.1
    assert first.at_high - first.at_low > 0.8
    assert first.p is not None and second.p is not None and first.p < 1e-10 and second.p > 0.05
    assert sensitivities(surface, ["speed", "delay"], shares, list(badness), seed=0) == (first, second)


def test_too_few_values_have_no_correlation() -> None:
    shares = RNG(7).random((12, 1))
    surface = fit_surface(shares, [True] * 12)
    (only,) = sensitivities(surface, ["speed"], shares, [None] * 12, seed=0)
    assert (only.correlation, only.p) == (None, None)
