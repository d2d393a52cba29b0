"""An impact table as data for a fit: the law is run through each impact from the state before it.

Nothing but velocities is compared: where exactly the block was when they were measured is rarely known to the depth of
an indentation. On a hard floor the time in contact is not seen either, so only the ratio of stiffnesses can be told.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from rock2d.diagnosis.film_data import history_groups, incident_features, incident_groups
from rock2d.diagnosis.fitting import Residuals
from rock2d.diagnosis.impact_prediction import nearest_facet, release_order
from rock2d.engines.batch import run_batch, world_ensemble
from rock2d.engines.geometry import block_arrays, ground_arrays
from rock2d.files.experiment import Experiment
from rock2d.kinematics.flights import clearances
from rock2d.kinematics.states import DEGREES, drift
from rock2d.scene.world import World

Array = np.ndarray

ABOVE = 0.3  # block radii that the block is taken back before the touch
INSTANT_S = 1e-6  # for velocities in the image
PATIENCE = 3.0  # longest wait for the end of an impact, in √(radius / g)


@dataclass
class TableData:
    """Impacts of a table; see `fitting.Data`.

    Attributes
    ----------
    before : (n, 6) recorded states before the impacts; `after` (n, 3) recorded velocities after them
    """

    before: Array
    after: Array
    impact_block: Array
    impact_zone: Array
    tangent: Array
    impact_release: Array
    impact_order: Array
    order: Array

    @property
    def flight_release(self) -> Array:
        return np.empty(0, np.int64)

    def only(self, releases: Array) -> TableData:
        own = releases[self.impact_release]
        rows = {f.name: getattr(self, f.name)[own] for f in fields(self) if f.name != "order"}
        return replace(self, **rows)

    def left(self, world: World, shift: Array | None = None) -> Residuals:
        """Simulated less recorded velocities after each impact: along the ground, across it, spin."""
        true = _true_states(world, self.before)
        if shift is not None:
            true = true + shift
        blocks = list(world.blocks.values())
        size = np.array([b.radius_m for b in blocks])[self.impact_block]
        ground = ground_arrays(world.cross_section, 10 * size.max())
        starts = true.copy()
        for b, block in enumerate(blocks):
            own = self.impact_block == b
            gap = clearances(block_arrays(block), ground, starts[own, :3])
            starts[own, 0] += gap * self.tangent[own, 1]  # along the normal until it just touches
            starts[own, 1] -= gap * self.tangent[own, 0]
        pace = np.maximum(np.hypot(starts[:, 3], starts[:, 4]), 0.05)
        starts = drift(world, self.impact_block, starts, -ABOVE * size / pace)
        ensemble, tables = world_ensemble(world)
        limit = PATIENCE * np.sqrt(size / max(world.gravity_m_s2, 1e-3)) + 10 * ABOVE * size / pace
        result = run_batch(
            ensemble, starts, block_ids=self.impact_block, table_ids=tables, gravity_m_s2=world.gravity_m_s2,
            time_limit_s=limit, impact_limit=1, impact_room=1,
        )  # fmt: skip
        end = result.impacts[:, 0, 9:15]
        recorded = _recorded_velocities(world, end)
        tx, ty = self.tangent.T
        d = recorded - self.after
        left = np.column_stack([tx * d[:, 0] + ty * d[:, 1], -ty * d[:, 0] + tx * d[:, 1], d[:, 2]])
        return Residuals(left, np.empty((0, 3, DEGREES)))

    def incident(self, world: World) -> Array:
        """(n, 6) states before the impacts."""
        return _true_states(world, self.before)

    def state_noise(self, world: World) -> Array:
        """Nothing is known of it: all noise of a table is fitted, see `extra_scatter`."""
        return np.zeros((len(self.before), 6, 6))

    def outcome_noise(self) -> Array:
        """(n, 3, 3): a floor for numbers that a table gives with a few digits."""
        return np.eye(3) * (1e-3 * self._spread()) ** 2 * np.ones((len(self.before), 1, 1))

    def extra_scatter(self) -> Array:
        """(n, 3, 3) directions of the measurement's noise: the velocities, in units of their own spread."""
        return np.eye(3) * self._spread() * np.ones((len(self.before), 1, 1))

    def _spread(self) -> Array:
        return np.maximum(self.after.std(axis=0), 1e-6)

    def impact_features(self, world: World) -> Array:
        """(n, features) of impacts."""
        return np.column_stack(
            [
                incident_features(world, self.impact_block, self.impact_zone, self.tangent, self.before),
                self.impact_order,
            ]
        )

    def impact_groups(self, world: World) -> dict[str, Array]:
        """Groups of what is known of each impact."""
        groups = incident_groups(world, self.impact_block, self.impact_zone, self.tangent, self.before)
        return groups | history_groups(self.impact_release, self.impact_order, np.arange(len(self.before)))

    def flight_groups(self, world: World) -> tuple[Array, dict[str, Array]]:
        """A table has no flights."""
        return np.empty(0), {}

    def flight_features(self, world: World) -> Array:
        """A table has no flights."""
        return np.empty((0, 1))


def _true_states(world: World, recorded: Array) -> Array:
    """States of the centre of mass from recorded states (n, 6) of the centroid."""
    now = world.view.true(recorded[:, :3])
    soon = world.view.true(recorded[:, :3] + INSTANT_S * recorded[:, 3:])
    return np.column_stack([now, (soon - now) / (INSTANT_S * world.view.time_scale)])


def _recorded_velocities(world: World, true: Array) -> Array:
    """(n, 3) velocities in the image of true states (n, 6)."""
    now = world.view.record(true[:, :3])
    soon = world.view.record(true[:, :3] + INSTANT_S * true[:, 3:])
    return (soon - now) / INSTANT_S * world.view.time_scale


def table_data(experiment: Experiment) -> TableData:
    """Impacts of an experiment with an impact table; rows without a state after are left out."""
    table = experiment.impacts
    assert table is not None
    columns = ["x_m", "y_m", "theta_rad", "vx_m_s", "vy_m_s", "omega_rad_s"]
    after = ["vx_after_m_s", "vy_after_m_s", "omega_after_rad_s"]
    table = table.dropna(subset=[*columns, *after]).sort_values("release", kind="stable")
    names = list(experiment.blocks)
    releases, index = np.unique(table["release"].to_numpy(), return_inverse=True)
    block = table["block"].map({name: i for i, name in enumerate(names)}).to_numpy(np.int64)
    first = np.searchsorted(index, np.arange(len(releases)))
    before = table[columns].to_numpy(float)
    facet = nearest_facet(before[:, :2], experiment.cross_section)
    order = release_order(block[first]).astype(float)
    return TableData(
        before, table[after].to_numpy(float), block, experiment.cross_section.zone_ids[facet],
        experiment.cross_section.tangents[facet], index, order[index], order,
    )  # fmt: skip
