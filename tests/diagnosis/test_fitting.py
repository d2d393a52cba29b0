"""The steps of a fit: what they must do whatever is fitted."""

from __future__ import annotations

import numpy as np
import pytest

from rock2d.diagnosis.fitting import newton_step


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
