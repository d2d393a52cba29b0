"""An impact table as data for a fit: the law is simulated through each impact from the state before it.

Only velocities are compared: the position of the block at the instant of the measurement is rarely known to the depth
of an indentation. On a hard floor the time in contact is not seen either, so the data determine only the ratio of the
stiffnesses.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from rock2d.diagnosis.quantities import (
    SERIES,
    history_quantities,
    incident_features,
    incident_quantities,
    moving_quantities,
)
from rock2d.diagnosis.residuals import Residuals
from rock2d.engines.batch import run_world
from rock2d.kinematics.film_segments import POSE_SIZE, STATE_SIZE
from rock2d.kinematics.flights import heights
from rock2d.kinematics.impact_table import SPIN_AFTER, VELOCITY_AFTER, ImpactTable
from rock2d.kinematics.impacts import ground_axes
from rock2d.kinematics.states import RESIDUAL_DEGREES, move_freely
from rock2d.records.columns import AFTER, BEFORE, INSTANT_STATE, POSE, RATES, VX, VY, X, Y
from rock2d.scene.world import World

Array = np.ndarray

START_GAP_RADII = 0.3  # block radii by which the block is moved back before the touch
SLOWEST_START_M_S = 0.05  # speed of a slower block when it is moved back
VELOCITY_STEP_S = 1e-6  # for velocities in the image
LONGEST_IMPACT = 3.0  # in √(radius / g)
RELATIVE_PRECISION = 1e-3  # precision of the numbers in a table, in units of the spread of their column


@dataclass
class TableData(ImpactTable):
    """n impacts of a table, with the methods of `film_data.FilmData`."""

    @property
    def flight_release(self) -> Array:
        return np.empty(0, np.int64)

    @property
    def flight_block(self) -> Array:
        return np.empty(0, np.int64)

    def coarse(self) -> Self:
        """The same: single impacts take little time."""
        return self

    def residuals(self, world: World, shift: Array | None = None) -> Residuals:
        """Simulated less recorded velocities after each impact: along the ground, across it, spin. `shift` (6,) or
        (n, 6) is added to the states before.

        A block that the impact does not throw off has the velocities with which it stays on the ground.
        """
        true = _true_states(world, self.before)
        if shift is not None:
            true = true + shift
        size = np.array([b.radius_m for b in world.blocks.values()])[self.impact_block]
        starts, gap = true.copy(), heights(world, self.impact_block, true[:, POSE])
        starts[:, X] += gap * self.tangent[:, Y]  # along the normal until it just touches
        starts[:, Y] -= gap * self.tangent[:, X]
        pace = np.maximum(np.hypot(starts[:, VX], starts[:, VY]), SLOWEST_START_M_S)
        earlier = move_freely(world, self.impact_block, starts, -START_GAP_RADII * size / pace)
        # the way back of a slow block, or of one that turns into the ground, may not be clear
        clear = heights(world, self.impact_block, earlier[:, POSE]) > 0.0
        starts = np.where(clear[:, None], earlier, starts)
        lasts = LONGEST_IMPACT * np.sqrt(size / max(world.gravity_m_s2, 1e-3))
        limit = lasts + 10 * START_GAP_RADII * size / pace
        result = run_world(
            world, starts, self.impact_block, time_limit_s=limit, impact_limit=1, impact_room=1
        )
        touch = result.impacts[:, 0]
        leaves = np.isfinite(touch[:, AFTER])
        stays = np.isfinite(touch[:, BEFORE]) & ~leaves
        end = np.where(stays, result.ends[:, INSTANT_STATE], touch[:, AFTER])
        recorded = _recorded_velocities(world, end)
        d = recorded - self.after
        residuals = np.column_stack([*ground_axes(self.tangent, d[:, VELOCITY_AFTER]), d[:, SPIN_AFTER]])
        return Residuals(residuals, np.empty((0, POSE_SIZE, RESIDUAL_DEGREES)))

    def incident(self, world: World) -> Array:
        """(n, 6) states before the impacts."""
        return _true_states(world, self.before)

    def state_noise(self, world: World) -> Array:
        """Zero: the noise of a table is not known. It is fitted, see `extra_scatter`."""
        return np.zeros((len(self.before), STATE_SIZE, STATE_SIZE))

    def outcome_noise(self) -> Array:
        """(n, 3, 3): a floor for numbers that a table gives with a few digits."""
        return np.eye(3) * (RELATIVE_PRECISION * self._spread()) ** 2 * np.ones((len(self.before), 1, 1))

    def extra_scatter(self) -> Array:
        """(n, 3, 3) directions of the measurement's noise: the velocities, in units of their own spread."""
        return np.eye(3) * self._spread() * np.ones((len(self.before), 1, 1))

    def _spread(self) -> Array:
        return np.maximum(self.after.std(axis=0), 1e-6)

    def impact_features(self, world: World) -> Array:
        """(n, features) of impacts."""
        known = incident_features(world, self.impact_block, self.impact_zone, self.tangent, self.before)
        return np.column_stack([known, self.impact_order])

    def impact_quantities(self, world: World) -> dict[str, Array]:
        """Name -> (n,): what is known of each impact before it happens; see `incident_quantities`."""
        found = incident_quantities(
            world, self.impact_block, self.impact_zone, self.tangent, self.incident(world)
        )
        return found | history_quantities(self.impact_release, self.impact_order, np.arange(len(self.before)))

    def outcome_quantities(self, world: World) -> dict[str, Array]:
        """The same of the velocities after."""
        return moving_quantities(self.after) | {SERIES: self.impact_order.astype(float)}

    def flight_features(self, world: World) -> Array:
        """A table has no flights."""
        return np.empty((0, 1))


def _true_states(world: World, recorded: Array) -> Array:
    """States of the centre of mass from recorded states (n, 6) of the centroid."""
    here = world.view.true(recorded[:, POSE])
    ahead = world.view.true(recorded[:, POSE] + VELOCITY_STEP_S * recorded[:, RATES])
    return np.column_stack([here, (ahead - here) / (VELOCITY_STEP_S * world.view.time_scale)])


def _recorded_velocities(world: World, true: Array) -> Array:
    """(n, 3) velocities in the image of true states (n, 6)."""
    here = world.view.record(true[:, POSE])
    ahead = world.view.record(true[:, POSE] + VELOCITY_STEP_S * true[:, RATES])
    return (ahead - here) / VELOCITY_STEP_S * world.view.time_scale
