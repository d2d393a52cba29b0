"""Whether the two engines agree on an impact of the hunt, and why not."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rock2d.engines.batch import BATCH_STEP_FRACTION
from rock2d.records.columns import VELOCITIES_AFTER
from tests.hunt.cases import GRAVITY_M_S2, Case
from tests.hunt.impact_check import batch_impact, pymunk_impact
from tests.hunt.own_geometry import LeftOutError

Array = np.ndarray

APART = 0.01  # share of the highest possible speed: engines further apart after an impact disagree


class Apart(NamedTuple):
    """How far the engines are apart after a first impact, as a share of the incident speed."""

    size: float
    reason: str  # "" while they agree


def compare(case: Case) -> Apart | None:
    """The engines on the first impact of a release; None if the batch engine's does not end with a rebound."""
    batch = _batch(case, 1.0)
    if batch is None:  # a release that comes to rest in its first contact takes pymunk hours
        return None
    pymunk = _pymunk(case, 1.0)
    size = _difference(batch, pymunk)
    if size <= APART:
        return Apart(size, "")
    fine_batch, fine_pymunk = _batch(case, 0.25), _pymunk(case, 0.5)
    if _difference(fine_batch, fine_pymunk) <= APART:
        return Apart(size, "step: they agree with shorter steps")
    if max(_difference(batch, fine_batch), _difference(pymunk, fine_pymunk)) > APART:
        return Apart(size, "knife edge: one engine's own result changes with its step")
    if _depends_on_start(case, batch):
        return Apart(size, "knife edge: a start moved by a millionth of the radius changes the impact")
    return Apart(size, "unexplained")


def _difference(one: Array | None, other: Array | None) -> float:
    """Largest difference of two results, inf if only one impact ended with a rebound."""
    if one is None or other is None:
        return 0.0 if one is other else np.inf
    return float(np.abs(one - other).max())


def _scale(case: Case) -> Array:
    """What differences of (vx, vy, omega) are shares of: the speed with which the block can come at most."""
    site, q = case.site, case.state
    fall = max(q[1] - site.cross_section.points_m[:, 1].min(), 0.0)
    speed = np.sqrt(q[3] ** 2 + q[4] ** 2 + 2.0 * GRAVITY_M_S2 * fall)
    return speed / np.array([1.0, 1.0, site.block.reach_m])


def _batch(case: Case, refinement: float) -> Array | None:
    """(3,) velocities after the first impact over `_scale`, by the batch engine; None if it did not end."""
    try:
        return batch_impact(case, refinement * BATCH_STEP_FRACTION)[VELOCITIES_AFTER] / _scale(case)
    except LeftOutError:
        return None


def _pymunk(case: Case, refinement: float) -> Array | None:
    """`_batch` by the pymunk engine."""
    after = pymunk_impact(case, refinement)[VELOCITIES_AFTER] / _scale(case)
    return None if np.isnan(after).any() else after


def _depends_on_start(case: Case, batch: Array | None) -> bool:
    """Whether starts a millionth of the radius beside lead elsewhere."""
    shift = 1e-6 * case.site.block.radius_m * np.eye(6)[:2]
    moved = [_batch(Case(case.site, case.state + sign * s), 1.0) for s in shift for sign in (-1.0, 1.0)]
    return any(_difference(batch, m) > APART for m in moved)
