"""Impacts of several strikes: which of them the later soil changes, and what that does to the likelihood."""

from dataclasses import replace

import numpy as np
import pytest

from rock2d.diagnosis.derivatives import residual_covariance
from rock2d.diagnosis.later_strikes import by_later_strikes
from rock2d.diagnosis.likelihood import fit_scatter, log_likelihood
from rock2d.engines.batch import run_world
from tests.kinematics.synthetic_films import base_fit, film, world


@pytest.fixture(scope="module")
def fitted():
    return base_fit(film(world(), 24, seed=5))


def test_the_soil_of_later_strikes_acts_where_there_are_later_strikes(fitted):
    data, base = fitted
    true = base.model.world(base.p, data.impact_order)
    instants_s = data.instants_s(true)
    strikes = run_world(
        true, data.starts(true, data.states(true)), data.impact_block, time_limit_s=instants_s[:, -1], impact_room=4,
        step_fraction=data.step_fraction,
    ).impact_count  # fmt: skip
    later = np.abs(by_later_strikes(base.model, base.p, data)).max(axis=(1, 2))
    assert (later[strikes == 1] == 0.0).all()
    assert np.mean(later[strikes > 1] > 0.0) > 0.9
    assert 3 < (strikes > 1).sum() < 0.7 * len(strikes)


def test_a_soil_that_varies_from_strike_to_strike_is_found_as_such(fitted):
    """Drawn amounts, for the first strike and the later ones each its own: the scatter is found, and the draws are less
    probable if both strikes must share one."""
    base = fitted[1]
    jacobian, rng = base.jacobian, np.random.default_rng(0)
    sigma, n = np.full(5, 0.1), len(jacobian.scatter)
    parts = (jacobian.scatter - jacobian.later, jacobian.later)
    r = sum(np.einsum("ndk,nk->nd", part, sigma * rng.normal(size=(n, 5))) for part in parts)
    r = r + np.einsum("nij,nj->ni", np.linalg.cholesky(jacobian.covariance), rng.normal(size=r.shape))
    shared = replace(jacobian, later=np.zeros_like(jacobian.later))
    found, alike = (fit_scatter(r, own, np.full(5, 0.05)) for own in (jacobian, shared))
    assert found[:2] == pytest.approx(sigma[:2], rel=0.3)
    totals = [log_likelihood(r, residual_covariance(own, s)).sum() for own, s in ((jacobian, found), (shared, alike))]
    assert totals[0] > totals[1] + 5.0
