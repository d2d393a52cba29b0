"""The soil's scatter: found where it was drawn, and the best there is."""

from dataclasses import replace

import numpy as np
import pytest

from rock2d.diagnosis.derivatives import START_SCATTER, Jacobian, Noise, residual_covariance
from rock2d.diagnosis.likelihood import PRIOR_SCATTER, fit_scatter, log_likelihood, scatter_errors

SOIL = np.array([0.08, 0.03, 0.15])


def impacts(soil, count=800, seed=5, further=0.0):
    """(n, 6) residuals of impacts on a soil that varies, and their derivatives; `further`: the standard deviation of
    what goes beyond first order, if there is any."""
    rng = np.random.default_rng(seed)
    by_soil = rng.normal(size=(count, 6, len(soil)))
    root = 0.05 * rng.normal(size=(count, 6, 6))
    noise = root @ root.transpose(0, 2, 1) + 1e-4 * np.eye(6)
    drawn = (by_soil @ (soil * rng.normal(size=(count, len(soil))))[..., None])[..., 0]
    # residuals from a Student distribution, as the likelihood takes them, so that no outlier is missing
    heavy = np.sqrt(4.0 / rng.chisquare(4.0, count))[:, None]
    own = np.einsum("nij,nj->ni", np.linalg.cholesky(noise), rng.normal(size=(count, 6)))
    beyond = rng.normal(size=(count, 6, 2 if further else 0))
    own += np.einsum("nij,nj->ni", beyond, further * rng.normal(size=(count, beyond.shape[-1])))
    by_soil = np.concatenate([by_soil, np.zeros((count, 6, 1 if further else 0))], axis=-1)
    none = np.empty((count, 6, 0)), np.empty((0, 3, 2, 0))
    return heavy * (drawn + own), Jacobian(*none, by_soil, 0.0 * by_soil, 0.0 * by_soil, Noise(noise, beyond))


def posterior(r, slope, soil):
    return log_likelihood(r, residual_covariance(slope, soil)).sum() - 0.5 * ((soil / PRIOR_SCATTER) ** 2).sum()


def test_the_scatter_is_found_where_it_was_drawn():
    r, slope = impacts(SOIL)
    assert fit_scatter(r, slope, np.full(3, 0.05)) == pytest.approx(SOIL, rel=0.15)


@pytest.mark.parametrize("start", [0.003, 0.05, 0.8])
def test_no_other_scatter_is_more_probable(start):
    """Steps of one per cent in every direction lose, from whatever start; what is absent is nearly zero."""
    r, slope = impacts(np.array([0.08, 0.0, 0.15]))
    found = fit_scatter(r, slope, np.full(3, start))
    best = posterior(r, slope, found)
    for k in range(3):
        for factor in (0.9, 1.1):
            other = found * np.where(np.arange(3) == k, factor, 1.0)
            assert posterior(r, slope, other) < best + 1e-2
    assert found[1] < 0.02


@pytest.mark.parametrize("size", [0.1, 1.0, 4.0])
def test_what_goes_beyond_first_order_has_a_standard_deviation_of_its_own(size):
    """Residuals with more of it than was drawn: its size is found, and the soil's stays what it is. It is never less
    than was drawn."""
    r, slope = impacts(SOIL, 1500, further=START_SCATTER * size)
    found = fit_scatter(r, slope, np.full(len(SOIL) + 1, START_SCATTER))
    assert found == pytest.approx([*SOIL, START_SCATTER * max(size, 1.0)], rel=0.15)


def test_the_stated_errors_are_those_of_repeated_draws():
    found = []
    for seed in range(40):
        r, slope = impacts(SOIL, 200, seed)
        fitted = fit_scatter(r, slope, SOIL)
        found.append([fitted / SOIL, scatter_errors(r, slope, fitted)])
    drawn, stated = np.std([one for one, _ in found], axis=0), np.mean([one for _, one in found], axis=0)
    assert stated == pytest.approx(drawn, rel=0.35)  # the standard deviation of 40 draws is known to 11 %


def test_a_scatter_counts_to_second_order():
    """Residuals a x + b x² of a known x: its standard deviation is found, and neither more nor less is as probable. To
    first order alone it is found too small: what the bend adds looks like outliers."""
    sigma, (none, slope) = 0.1, impacts(np.zeros(1), 1500)
    rng = np.random.default_rng(2)
    bend = 8.0 * rng.normal(size=slope.scatter.shape)
    x = sigma * rng.normal(size=len(none))
    drawn = slope.scatter[..., 0] * x[:, None] + bend[..., 0] * x[:, None] ** 2 / np.sqrt(2.0)
    noise = np.einsum("nij,nj->ni", np.linalg.cholesky(slope.noise.covariance), rng.normal(size=none.shape))
    r, start = drawn + noise, np.full(1, 0.03)
    bent = replace(slope, bend=bend)
    found = fit_scatter(r, bent, start)
    for factor in (0.9, 1.1):
        assert posterior(r, bent, factor * found) < posterior(r, bent, found)
    assert found == pytest.approx([sigma], rel=0.25)
    assert fit_scatter(r, slope, start) < 0.8 * found
