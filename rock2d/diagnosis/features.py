"""Features of an impact that are known before it happens: for the regression of the residuals and, in groups, for the
search for dependences."""

from __future__ import annotations

import numpy as np

from rock2d.kinematics.impacts import ground_axes
from rock2d.records.columns import LINEAR_VELOCITY, OMEGA, THETA, X, Y
from rock2d.scene.world import World

Array = np.ndarray

PLACES = 10  # parts of the set-up, with equal numbers of impacts
CONSTANT = "nothing"  # the group of a constant, which depends on nothing
# the orientation at the touch is extrapolated over this time: radii over the normal velocity, which counts at least as
TOUCH_RADII, SLOWEST_TOUCH_M_S = 0.3, 0.1


def incident_features(world: World, block: Array, zone: Array, tangent: Array, before: Array) -> Array:
    """(n, features) of impacts from the states `before` them (n, 6)."""
    size = np.array([b.radius_m for b in world.blocks.values()])[block]
    tx, ty = tangent.T
    along, across = ground_axes(tangent, before[:, LINEAR_VELOCITY])
    omega = before[:, OMEGA]
    spin = omega * size
    closing = np.maximum(np.abs(across), SLOWEST_TOUCH_M_S)
    lean = before[:, THETA] + omega * TOUCH_RADII * size / closing - np.arctan2(ty, tx)
    angles = [f(k * lean) for k in (1, 2, 4) for f in (np.sin, np.cos)]
    kinds = [block == b for b in range(len(world.blocks))] + [zone == z for z in np.unique(zone)]
    return np.column_stack(
        [along, across, spin, along + spin, before[:, X], before[:, Y], along * across, *angles, *kinds,
         *[k * across for k in kinds], *[k * along for k in kinds]]
    )  # fmt: skip


def incident_groups(
    world: World, block: Array, zone: Array, tangent: Array, before: Array
) -> dict[str, Array]:
    """Groups of features of the states before the impacts: name -> (n, features), see `discrepancy`."""
    size = np.array([b.radius_m for b in world.blocks.values()])[block]
    tx, ty = tangent.T
    along, across = ground_axes(tangent, before[:, LINEAR_VELOCITY])
    theta, spin = before[:, THETA], before[:, OMEGA] * size
    lean = theta - np.arctan2(ty, tx)
    groups = {
        "block": np.eye(len(world.blocks))[block],
        "zone": np.eye(int(zone.max()) + 1)[zone],
        "place": place_features(before[:, X]),
        "orientation to the ground": np.column_stack(
            [f(k * lean) for k in (1, 2, 4) for f in (np.sin, np.cos)]
        ),
        "orientation": np.column_stack([f(k * theta) for k in (1, 2) for f in (np.sin, np.cos)]),
        "speed": np.column_stack([along, across, np.hypot(along, across)]),
        "spin": np.column_stack([spin, np.abs(spin), along + spin, np.abs(along + spin)]),
    }
    return {CONSTANT: np.ones((len(block), 1))} | {k: standardised(v) for k, v in groups.items()}


def place_features(x: Array) -> Array:
    """(n, PLACES) in which part of the set-up each place is, as 0 and 1; every part holds equally many places."""
    return np.eye(PLACES)[np.digitize(x, np.quantile(x, np.linspace(0.0, 1.0, PLACES + 1)[1:-1]))]


def history_groups(release: Array, order: Array, began: Array) -> dict[str, Array]:
    """What happened before an impact: `order` of its release in the series, instant at which it `began`."""
    number = np.zeros(len(release))
    for r in np.unique(release):
        own = release == r
        number[own] = np.argsort(np.argsort(began[own]))
    groups = {"series": order[:, None], "history": np.column_stack([number, number == 0])}
    return {k: standardised(v) for k, v in groups.items()}


def standardised(features: Array) -> Array:
    """Columns with zero mean and unit variance; constant columns are dropped."""
    spread = features.std(axis=0)
    varies = spread > 1e-9 * (1.0 + np.abs(features).max(axis=0, initial=0.0))
    return np.asarray((features[:, varies] - features[:, varies].mean(axis=0)) / spread[varies])
