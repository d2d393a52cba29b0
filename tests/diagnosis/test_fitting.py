"""The steps of a fit: what they must do whatever is fitted."""

import numpy as np
import pytest

from rock2d.diagnosis.checks import FAR
from rock2d.diagnosis.data import Residuals
from rock2d.diagnosis.derivatives import Jacobian, Noise, drawn_impacts, square_roots, times_normal
from rock2d.diagnosis.likelihood import chi_square, clustered_covariance, newton_step, normal_equations
from rock2d.diagnosis.model import BASE_WIDTH
from tests.kinematics.synthetic_films import base_fit, film, series_order, world


@pytest.mark.parametrize("seed", range(4))
def test_a_parameter_held_by_its_bound_leaves_the_others_at_their_least(seed):
    """On a parabola with correlated parameters one step is enough, from any place, with two at their bounds."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(5, 5))
    curve = root @ root.T + 0.1 * np.eye(5)
    low, high = -np.full(5, 0.5), np.full(5, 0.5)
    p = np.array([0.5, 0.2, -0.1, -0.5, 0.3])
    grad = rng.normal(size=5)
    grad[[0, 3]] = -1.0, 2.0  # downhill is out of bounds
    after = p - newton_step(curve, grad, p, low, high)
    assert after[[0, 3]] == pytest.approx(p[[0, 3]])
    assert (grad + curve @ (after - p))[[1, 2, 4]] == pytest.approx(np.zeros(3), abs=1e-9)
    grad[0] = 1.0  # downhill is back inside
    assert newton_step(curve, grad, p, low, high)[0] != 0.0


@pytest.mark.parametrize("shared", [0.0, 1.5])
def test_intervals_hold_where_the_residuals_of_a_release_depend_on_each_other(shared):
    """Draws of residuals with and without a part that a whole release shares: the stated variance of a fitted slope is
    the one that the fits have, and never smaller than for independent residuals."""
    rng = np.random.default_rng(1)
    releases, each = 60, 8
    release, none = np.repeat(np.arange(releases), each), np.empty(0, np.int64)
    j = np.column_stack([np.ones(releases * each), np.repeat(rng.normal(size=releases), each)])[:, None]
    noise, flights = np.ones((releases * each, 1, 1)), np.empty((0, 3, 2))
    *none_scatter, beyond = np.empty((4, releases * each, 1, 0))
    slope = Jacobian(j, np.empty((0, 3, 2, 2)), *none_scatter, Noise(noise, beyond))
    found, stated, plain = [], [], []
    for _ in range(300):
        r = rng.normal(size=(releases * each, 1)) + shared * rng.normal(size=(releases, 1))[release]
        step = np.zeros(2)
        for _ in range(20):
            left = Residuals(r - j @ step, flights)
            curve, grad = normal_equations(left, slope, noise)
            step += np.linalg.solve(curve, grad)
        found.append(step)
        own = clustered_covariance(left, slope, noise, curve, (release, none), releases)
        stated.append(np.diag(own))
        plain.append(np.diag(np.linalg.inv(curve)))
    ratio = np.mean(stated, axis=0) / np.var(found, axis=0)
    assert ratio == pytest.approx(np.ones(2), abs=0.3)
    assert (np.array(stated) >= np.array(plain) * (1.0 - 1e-12)).all()
    if shared:
        assert (np.mean(plain, axis=0) < 0.4 * np.var(found, axis=0)).all()


def test_parameters_that_no_data_tell_apart_share_the_shortest_step():
    alike, free = np.ones((2, 2)), np.full(2, np.inf)
    assert newton_step(alike, np.ones(2), np.zeros(2), -free, free) == pytest.approx([0.5, 0.5])


def test_covariances_hold_what_noise_and_soil_do_to_impacts():
    """Draws that a fit has not seen lie within its covariances, those of impacts on an edge, too: with first order and
    the curvature along single axes alone 1 in 170 to 300 of them would be far, and the mean would be 1.4 to 1.7."""
    releases, rng = 20, np.random.default_rng(9)
    data, found = base_fit(film(world(series_order(releases)), releases, noise_m=1e-4, noise_rad=0.005, soil=0.1))
    before = square_roots(data.state_noise(found.model.world(found.p, data.impact_order)))
    after, covariance, square = square_roots(data.outcome_noise()), found.covariance(), []
    for _ in range(100):
        soil = found.scatter[: len(BASE_WIDTH)] * rng.normal(size=(len(before), len(BASE_WIDTH)))
        drawn = drawn_impacts(found.model, found.p, data, soil, times_normal(before, rng)) - found.residuals.impacts
        square.append(chi_square(drawn + times_normal(after, rng), covariance) / drawn.shape[1])
    assert 0.9 < np.mean(square) < 1.2
    assert np.mean(np.array(square) > FAR**2) < 0.002
