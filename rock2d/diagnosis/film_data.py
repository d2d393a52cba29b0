"""A film as data for a fit: its segments, and the residuals that a world leaves in them."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Self

import numpy as np

from rock2d.diagnosis.impact_prediction import outcomes
from rock2d.diagnosis.quantities import (
    SERIES,
    TIME_S,
    history_quantities,
    incident_features,
    incident_quantities,
    moving_quantities,
)
from rock2d.diagnosis.residuals import Residuals
from rock2d.engines.batch import BATCH_STEP_FRACTION
from rock2d.kinematics.film_segments import STATE_SIZE, FilmSegments
from rock2d.records.columns import OMEGA, RATES, THETA, VX, VY, X, Y
from rock2d.scene.world import World

Array = np.ndarray

ALONG, ACROSS = range(2)  # columns of residuals of impacts; the same three columns later their rates
COARSE_STEPS = 2.0  # times as long: the residuals change by 0.01 of the noise (median), 0.3 (95 %)


@dataclass
class FilmData(FilmSegments):
    """n impacts and m flights of a film. `step_fraction`: that of the simulated impacts, see `run_batch`.

    Attributes
    ----------
    impact_release, impact_block, impact_zone : (n,) index of release, block and zone of each impact
    impact_order : (n,) place of each impact's release in its block's series
    tangent : (n, 2) direction of the ground at each impact
    flight_release, flight_block : (m,) index of release and block of each flight
    """

    step_fraction: float = BATCH_STEP_FRACTION

    def coarse(self) -> Self:
        """The same, but impacts are simulated in fewer steps: for a first look."""
        return replace(self, step_fraction=COARSE_STEPS * self.step_fraction)

    def flights_alone(self) -> Self:
        """The same without impacts."""
        none = {f.name: getattr(self.impacts, f.name)[:0] for f in fields(self.impacts)}
        return replace(self, impacts=replace(self.impacts, **none))

    @property
    def impact_release(self) -> Array:
        return self.impacts.release

    @property
    def flight_release(self) -> Array:
        return self.segmentation.flights.release

    @property
    def flight_block(self) -> Array:
        return self.segmentation.flights.block

    @property
    def impact_order(self) -> Array:
        return self.impacts.order

    @property
    def impact_block(self) -> Array:
        return self.impacts.block

    @property
    def impact_zone(self) -> Array:
        return self.impacts.zone

    @property
    def tangent(self) -> Array:
        return self.impacts.tangent

    def residuals(self, world: World, shift: Array | None = None) -> Residuals:
        """Residuals in a world, in the camera's units; `shift` (6,) or (n, 6) is added to the states before the
        impacts."""
        states = self.states(world)
        difference = outcomes(world, self.impacts, states, shift, self.step_fraction)
        at, along = states.middle[self.impacts.after], self.impacts.tangent
        across = np.column_stack([-along[:, Y], along[:, X]])
        for c, direction in ((ALONG, along), (ACROSS, across)):
            difference[:, [c, VX + c]] /= world.view.true_per_recorded(at, direction)[:, None]
        difference[:, RATES] *= world.view.time_scale
        no_angle = self.unknown_spin[self.impacts.after] > 0.0
        difference[np.ix_(no_angle, (THETA, OMEGA))] = 0.0  # what was not measured shows no pattern
        seen = (self.film.measured * self.film.noise / self.film.long_noise)[:, None]
        return Residuals(difference, states.residuals * seen)

    def incident(self, world: World) -> Array:
        """(n, 6) states at the starts of the simulations."""
        return self.states_at(world, self.impacts.before, self.impacts.start_s)

    def state_noise(self, world: World) -> Array:
        """(n, 6, 6) covariance of the states before the impacts, in that world."""
        impacts = self.impacts
        return self.true_covariance(world, impacts.before, impacts.start_s, self.incident(world))

    def outcome_noise(self) -> Array:
        """(n, 6, 6) covariance of the states after the impacts, along the ground and across it."""
        after = self.state_covariance(self.impacts.after, self.impacts.begin_s)
        turn = np.zeros_like(after)
        tx, ty = self.impacts.tangent.T
        for x, y, theta in ((X, Y, THETA), (VX, VY, OMEGA)):
            turn[:, x, x], turn[:, x, y], turn[:, y, x], turn[:, y, y] = tx, ty, -ty, tx
            turn[:, theta, theta] = 1.0
        return turn @ after @ turn.transpose(0, 2, 1)

    def extra_scatter(self) -> Array:
        """(n, 6, 0) directions of noise whose size is fitted with the soil's scatter: none, it is estimated from the
        flights."""
        return np.empty((len(self.impacts), STATE_SIZE, 0))

    def impact_features(self, world: World) -> Array:
        """(n, features) of impacts: velocities along and across the facet, spin, orientation, place, order."""
        impacts = self.impacts
        known = incident_features(world, impacts.block, impacts.zone, impacts.tangent, self.incident(world))
        return np.column_stack([known, impacts.order, impacts.wait_s])

    def impact_quantities(self, world: World) -> dict[str, Array]:
        """Name -> (n,): what is known of each impact before it happens; see `incident_quantities`."""
        impacts = self.impacts
        began = self.basis.middle[impacts.before] + impacts.start_s
        found = incident_quantities(world, impacts.block, impacts.zone, impacts.tangent, self.incident(world))
        found |= history_quantities(impacts.release, impacts.order, began) | {TIME_S: self._times(world)}
        return found

    def outcome_quantities(self, world: World) -> dict[str, Array]:
        """The same of the flights after, as far as it is known then."""
        impacts = self.impacts
        after = self.states_at(world, impacts.after, impacts.begin_s)
        known = {SERIES: impacts.order.astype(float), TIME_S: self._times(world)}
        return moving_quantities(after[:, RATES]) | known

    def _times(self, world: World) -> Array:
        """(n,) true time in s from the beginning of the release to the end of each impact."""
        impacts = self.impacts
        begin = self.film.t_s[np.searchsorted(self.film.release, impacts.release)]
        return np.asarray(
            (self.basis.middle[impacts.after] + impacts.begin_s - begin) * world.view.time_scale
        )

    def flight_noise(self, world: World) -> Array:
        """(m, 3) standard deviation of the true coefficients of a flight that is 1 in the residuals."""
        noise = np.tile(self.film.long_noise, (len(self.flight_release), 1))
        middle = self.states(world).middle
        for c, axis in ((X, (1.0, 0.0)), (Y, (0.0, 1.0))):
            noise[:, c] *= world.view.true_per_recorded(middle, np.array(axis))
        return noise

    def flight_features(self, world: World) -> Array:
        """(m, features) of flights: accelerations that forces would cause, times the effect of one acceleration."""
        flights = self.segmentation.flights
        lever = self.lever()
        x, y, theta, vx, vy, w = self.states(world).middle.T
        speed, size = np.hypot(vx, vy), self._sizes(world)
        terms = [vx, vy, speed * vx, speed * vy, w * size * vx, w * size * vy, x, y, x * vx, y * vy,
                 self.order[flights.release], np.sin(theta), np.cos(theta), w * size * np.sin(theta),
                 w * size * np.cos(theta)]  # fmt: skip
        kinds = [flights.block == b for b in range(len(world.blocks))]
        return np.column_stack(
            [lever, *[t * lever for t in terms], *terms, *kinds, *[k * lever for k in kinds]]
        )

    def lever(self) -> Array:
        """(m,) bend of each flight under one acceleration, of unit mean square."""
        duration = 1.0 / (self.basis.slope * self.basis.level)
        lever = duration**2 / self.basis.level
        return np.asarray(lever / np.sqrt(np.mean(lever**2)))

    def _sizes(self, world: World) -> Array:
        return np.array([b.radius_m for b in world.blocks.values()])[self.segmentation.flights.block]
