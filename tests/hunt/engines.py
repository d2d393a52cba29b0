"""Whether the two engines agree on an impact of the hunt, and why not."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tests.hunt.cases import GRAVITY_M_S2, Case

Array = np.ndarray

APART = 0.01  # of the incident speed: engines further apart after an impact disagree


class Apart(NamedTuple):
    """How far the engines are apart after a first impact, as a share of the incident speed."""

    size: float
    reason: str  # "" while they agree


def compare(case: Case) -> Apart | None:
    """The engines on the first impact of a release; None if the batch engine's does not end with a rebound."""
    batch, pymunk = _batch(case, 1.0), _pymunk(case, 1.0)
    if batch is None:
        return None
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


def _batch(case: Case, refinement: float, state: Array | None = None) -> Array | None:
    """(3,) velocities after the first impact over `_scale`, by the batch engine; None if it did not end."""
    from rock2d.engines.batch import BATCH_STEP_FRACTION, Ensemble, run_batch
    from rock2d.laws.contact import parameter_table
    from rock2d.records.columns import STOP_IMPACTS, VELOCITIES_AFTER

    site = case.site
    table = parameter_table(site.soils, site.cross_section.zone_names)
    result = run_batch(
        Ensemble([site.block], [site.cross_section], [table]), case.state if state is None else state,
        gravity_m_s2=GRAVITY_M_S2, time_limit_s=site.time_limit_s, impact_limit=1, impact_room=1,
        step_fraction=refinement * BATCH_STEP_FRACTION,
    )  # fmt: skip
    if result.stop[0] != STOP_IMPACTS:
        return None
    return result.impacts[0, 0, VELOCITIES_AFTER] / _scale(case)


def _pymunk(case: Case, refinement: float) -> Array | None:
    """`_batch` by the pymunk engine."""
    from rock2d.effects.columns import engine_rows
    from rock2d.engines.contact_step import contact_steps_s
    from rock2d.engines.pymunk_engine import run_pymunk
    from rock2d.laws.contact import parameter_table

    site = case.site
    table = parameter_table(site.soils, site.cross_section.zone_names)
    track = run_pymunk(
        site.block, site.cross_section, table, case.state, gravity_m_s2=GRAVITY_M_S2,
        time_limit_s=site.time_limit_s, impact_limit=1,
        contact_step_s=refinement * contact_steps_s(site.block, engine_rows(table))[1],
    )  # fmt: skip
    if track.stop != "impacts":
        return None
    after = [track.impacts[0][k] for k in ("vx_after_m_s", "vy_after_m_s", "omega_after_rad_s")]
    return np.array(after) / _scale(case)


def _depends_on_start(case: Case, batch: Array | None) -> bool:
    """Whether starts a millionth of the radius beside lead elsewhere."""
    shift = 1e-6 * case.site.block.radius_m * np.eye(6)[:2]
    moved = [_batch(case, 1.0, case.state + sign * s) for s in shift for sign in (-1.0, 1.0)]
    return any(_difference(batch, m) > APART for m in moved)
