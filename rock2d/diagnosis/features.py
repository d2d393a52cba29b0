"""What is known of an impact before it happens: features for the regression of the residuals, and the quantities that
dependences are searched for."""

from __future__ import annotations

import numpy as np

from rock2d.diagnosis.quantities import (
    BLOCK,
    HISTORY,
    LEAN_RAD,
    MOST_COUNTED_IMPACTS,
    NORMAL_SPEED_M_S,
    OMEGA_RAD_S,
    PLACE_M,
    SERIES,
    SLIDING_SPEED_M_S,
    SPIN_M_S,
    TANGENTIAL_SPEED_M_S,
    THETA_RAD,
    VX_M_S,
    VY_M_S,
    ZONE,
)
from rock2d.kinematics.impacts import ground_axes
from rock2d.records.columns import LINEAR_VELOCITY, OMEGA, RATES, THETA, X, Y
from rock2d.scene.world import World

Array = np.ndarray

# the orientation at the touch is extrapolated over this time: radii over the normal velocity, which counts at least as
TOUCH_RADII, SLOWEST_TOUCH_M_S = 0.3, 0.1


def incident_features(world: World, block: Array, zone: Array, tangent: Array, before: Array) -> Array:
    """(n, features) of impacts from the states `before` them (n, 6)."""
    size = np.array([b.radius_m for b in world.blocks.values()])[block]
    along, across = ground_axes(tangent, before[:, LINEAR_VELOCITY])
    spin = before[:, OMEGA] * size
    lean = _lean(size, tangent, before, across)
    angles = [f(k * lean) for k in (1, 2, 4) for f in (np.sin, np.cos)]
    kinds = [block == b for b in range(len(world.blocks))] + [zone == z for z in np.unique(zone)]
    return np.column_stack(
        [along, across, spin, along + spin, before[:, X], before[:, Y], along * across, *angles, *kinds,
         *[k * across for k in kinds], *[k * along for k in kinds]]
    )  # fmt: skip


def incident_quantities(
    world: World, block: Array, zone: Array, tangent: Array, before: Array
) -> dict[str, Array]:
    """Name -> (n,): what the states `before` the impacts (n, 6) say; see `quantities`."""
    size = np.array([b.radius_m for b in world.blocks.values()])[block]
    along, across = ground_axes(tangent, before[:, LINEAR_VELOCITY])
    spin = before[:, OMEGA] * size
    return {
        BLOCK: block.astype(float),
        ZONE: zone.astype(float),
        PLACE_M: before[:, X],
        LEAN_RAD: _lean(size, tangent, before, across),
        THETA_RAD: before[:, THETA],
        NORMAL_SPEED_M_S: -across,
        TANGENTIAL_SPEED_M_S: along,
        SLIDING_SPEED_M_S: along + spin,
        SPIN_M_S: spin,
        **moving_quantities(before[:, RATES]),
    }


def moving_quantities(rates: Array) -> dict[str, Array]:
    """Name -> (n,): velocities in the image (n, 3), before or after an impact."""
    return {VX_M_S: rates[:, 0], VY_M_S: rates[:, 1], OMEGA_RAD_S: rates[:, 2]}


def _lean(size: Array, tangent: Array, before: Array, across: Array) -> Array:
    """(n,) orientation of the blocks to the ground at the touch, in rad."""
    closing = np.maximum(np.abs(across), SLOWEST_TOUCH_M_S)
    slope = np.arctan2(tangent[:, Y], tangent[:, X])
    return np.asarray(before[:, THETA] + before[:, OMEGA] * TOUCH_RADII * size / closing - slope)


def history_quantities(release: Array, order: Array, began: Array) -> dict[str, Array]:
    """What happened before an impact: `order` of its release in the series, instant at which it `began`."""
    number = np.zeros(len(release))
    for r in np.unique(release):
        own = release == r
        number[own] = np.argsort(np.argsort(began[own]))
    return {SERIES: order.astype(float), HISTORY: np.minimum(number, MOST_COUNTED_IMPACTS)}
