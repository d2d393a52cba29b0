"""A film as data for a fit: its flights, the impacts between them, and what a world leaves of both unexplained."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from rock2d.diagnosis.discrepancy import NOTHING, standard
from rock2d.diagnosis.fitting import Residuals
from rock2d.diagnosis.impact_prediction import Impacts, find_impacts, outcomes, release_order, start_instants
from rock2d.kinematics.flights import Cut, Film, cut_film
from rock2d.kinematics.states import Basis, States, drift, fit_states, flight_basis
from rock2d.scene.world import World

Array = np.ndarray

STRETCHES = 10  # of the set-up, with as many impacts each


@dataclass
class FilmData:
    """Flights and impacts of a film; see `fitting.Data`.

    Attributes
    ----------
    start_s : (flights,) see `bounces.start_instants`
    order : (releases,) place of each release in its block's series
    """

    cut: Cut
    basis: Basis
    impacts: Impacts
    start_s: Array
    order: Array

    @property
    def film(self) -> Film:
        return self.cut.film

    @property
    def impact_release(self) -> Array:
        return self.impacts.release

    @property
    def flight_release(self) -> Array:
        return self.cut.flights.release

    @property
    def impact_order(self) -> Array:
        return self.impacts.order

    @property
    def impact_block(self) -> Array:
        return self.impacts.block

    @property
    def impact_zone(self) -> Array:
        return self.impacts.zone

    def only(self, releases: Array) -> FilmData:
        flights = self.cut.flights
        keep, own = releases[flights.release], releases[self.impacts.release]
        index = np.append(np.cumsum(keep) - 1, -1)  # what follows no flight goes on to do so
        fewer = replace(
            flights, **{f.name: getattr(flights, f.name)[keep] for f in fields(flights) if f.name != "follows"},
            follows=index[flights.follows[keep]],
        )  # fmt: skip
        impacts = Impacts(*(getattr(self.impacts, f.name)[own] for f in fields(Impacts)))
        impacts.before, impacts.after = index[impacts.before], index[impacts.after]
        cut = replace(self.cut, flights=fewer)
        return FilmData(cut, self.basis.only(keep), impacts, self.start_s[keep], self.order)

    def states(self, world: World) -> States:
        """The flights' states in a world."""
        return fit_states(world, self.film, self.cut.flights, self.basis)

    def left(self, world: World, shift: Array | None = None) -> Residuals:
        """What a world leaves unexplained, in the camera's units."""
        states = self.states(world)
        difference = outcomes(world, self.impacts, states, shift)
        at, along = states.middle[self.impacts.after], self.impacts.tangent
        for c, direction in enumerate((along, np.column_stack([-along[:, 1], along[:, 0]]))):
            difference[:, [c, 3 + c]] /= world.view.true_per_recorded(at, direction)[:, None]
        difference[:, 3:] *= world.view.time_scale
        inflation = (self.film.long_noise / self.film.noise)[:, None]
        return Residuals(difference, states.left / inflation)

    def incident(self, world: World) -> Array:
        """(n, 6) states at the starts of the simulations."""
        impacts = self.impacts
        start = impacts.start_s * world.view.time_scale
        return drift(world, impacts.block, self.states(world).middle[impacts.before], start)

    def state_noise(self, world: World) -> Array:
        """(n, 6, 6) covariance of the states before the impacts, in that world."""
        impacts = self.impacts
        return self.true_covariance(world, impacts.before, impacts.start_s, self.incident(world))

    def outcome_noise(self) -> Array:
        """(n, 6, 6) covariance of the states after the impacts, along the ground and across it."""
        after = self.state_covariance(self.impacts.after, self.impacts.begin_s)
        turn = np.zeros_like(after)
        tx, ty = self.impacts.tangent.T
        for o in (0, 3):
            turn[:, o, o], turn[:, o, o + 1], turn[:, o + 1, o], turn[:, o + 1, o + 1] = tx, ty, -ty, tx
            turn[:, o + 2, o + 2] = 1.0
        return turn @ after @ turn.transpose(0, 2, 1)

    def extra_scatter(self) -> Array:
        """The noise of a film is known."""
        return np.empty((len(self.impacts), 6, 0))

    def true_covariance(self, world: World, which: Array, dt: Array, states: Array) -> Array:
        """`state_covariance` of what was recorded, taken back to the true `states` (n, 6) there."""
        unit = np.ones((len(which), 6))
        for c, axis in enumerate(np.eye(2)):
            unit[:, c] = unit[:, 3 + c] = world.view.true_per_recorded(states, axis)
        unit[:, 3:] /= world.view.time_scale
        return self.state_covariance(which, dt) * unit[:, :, None] * unit[:, None, :]

    def state_covariance(self, which: Array, dt: Array) -> Array:
        """(n, 6, 6) of the measured states of flights `which`, at recorded instants dt from their middle."""
        out = np.zeros((len(which), 6, 6))
        rate, level = self.basis.slope[which] ** 2, self.basis.level[which] ** 2
        for c in range(3):
            variance = self.film.long_noise[c] ** 2
            out[:, c, c] = variance * (level + rate * dt**2)
            out[:, c, 3 + c] = out[:, 3 + c, c] = variance * rate * dt
            out[:, 3 + c, 3 + c] = variance * rate
        return out

    def impact_features(self, world: World) -> Array:
        """(n, features) of impacts: velocities along and across the facet, spin, orientation, place, order."""
        impacts, before = self.impacts, self.incident(world)
        return np.column_stack(
            [
                incident_features(world, impacts.block, impacts.zone, impacts.tangent, before),
                impacts.order,
                impacts.wait_s,
            ]
        )

    def impact_groups(self, world: World) -> dict[str, Array]:
        """Groups of what is known of each impact; see `incident_groups`."""
        impacts = self.impacts
        groups = incident_groups(world, impacts.block, impacts.zone, impacts.tangent, self.incident(world))
        began = self.basis.middle[impacts.before] + impacts.start_s
        return groups | history_groups(impacts.release, impacts.order, began)

    def flight_features(self, world: World) -> Array:
        """(m, features) of flights: the accelerations that forces would cause, times the lever of the duration."""
        flights = self.cut.flights
        lever = self._lever()
        x, y, theta, vx, vy, w = self.states(world).middle.T
        speed, size = np.hypot(vx, vy), self._sizes(world)
        terms = [vx, vy, speed * vx, speed * vy, w * size * vx, w * size * vy, x, y, x * vx, y * vy,
                 self.order[flights.release], np.sin(theta), np.cos(theta), w * size * np.sin(theta),
                 w * size * np.cos(theta)]  # fmt: skip
        kinds = [flights.block == b for b in range(len(world.blocks))]
        return np.column_stack(
            [lever, *[t * lever for t in terms], *terms, *kinds, *[k * lever for k in kinds]]
        )

    def flight_groups(self, world: World) -> tuple[Array, dict[str, Array]]:
        """How much each flight (m,) bends under an acceleration, and what accelerations may depend on."""
        x, y, theta, vx, vy, w = self.states(world).middle.T
        speed = np.hypot(vx, vy)
        groups = {
            "velocity": np.column_stack([vx, vy, speed * vx, speed * vy]),
            "spin": np.column_stack([w, w * vx, w * vy]),
            "height": np.column_stack([y, y**2]),
            "place": np.eye(STRETCHES)[_stretch(x)],
            "orientation": np.column_stack([np.sin(theta), np.cos(theta), w**2 * np.sin(theta), w**2 * np.cos(theta)]),
            "block": np.eye(len(world.blocks))[self.cut.flights.block],
            "series": self.order[self.cut.flights.release][:, None],
        }  # fmt: skip
        return self._lever(), {NOTHING: np.ones((len(x), 1))} | {k: standard(v) for k, v in groups.items()}

    def _lever(self) -> Array:
        """(m,) bend of each flight under one acceleration, of unit mean square."""
        duration = 1.0 / (self.basis.slope * self.basis.level)
        lever = duration**2 / self.basis.level
        return np.asarray(lever / np.sqrt(np.mean(lever**2)))

    def _sizes(self, world: World) -> Array:
        return np.array([b.radius_m for b in world.blocks.values()])[self.cut.flights.block]


def incident_features(world: World, block: Array, zone: Array, tangent: Array, before: Array) -> Array:
    """(n, features) of impacts from the states before them."""
    size = np.array([b.radius_m for b in world.blocks.values()])[block]
    tx, ty = tangent.T
    along, across = before[:, 3] * tx + before[:, 4] * ty, -before[:, 3] * ty + before[:, 4] * tx
    spin = before[:, 5] * size
    lean = before[:, 2] + before[:, 5] * 0.3 * size / np.maximum(np.abs(across), 0.1) - np.arctan2(ty, tx)
    angles = [f(k * lean) for k in (1, 2, 4) for f in (np.sin, np.cos)]
    kinds = [block == b for b in range(len(world.blocks))] + [zone == z for z in np.unique(zone)]
    return np.column_stack(
        [along, across, spin, along + spin, before[:, 0], before[:, 1], along * across, *angles, *kinds,
         *[k * across for k in kinds], *[k * along for k in kinds]]
    )  # fmt: skip


def incident_groups(
    world: World, block: Array, zone: Array, tangent: Array, before: Array
) -> dict[str, Array]:
    """What an impact may depend on, from the states before: name -> (n, features), see `discrepancy`."""
    size = np.array([b.radius_m for b in world.blocks.values()])[block]
    tx, ty = tangent.T
    along, across = before[:, 3] * tx + before[:, 4] * ty, -before[:, 3] * ty + before[:, 4] * tx
    spin = before[:, 5] * size
    lean = before[:, 2] - np.arctan2(ty, tx)
    groups = {
        "block": np.eye(len(world.blocks))[block],
        "zone": np.eye(int(zone.max()) + 1)[zone],
        "place": np.eye(STRETCHES)[_stretch(before[:, 0])],
        "orientation to the ground": np.column_stack(
            [f(k * lean) for k in (1, 2, 4) for f in (np.sin, np.cos)]
        ),
        "orientation": np.column_stack([f(k * before[:, 2]) for k in (1, 2) for f in (np.sin, np.cos)]),
        "speed": np.column_stack([along, across, np.hypot(along, across)]),
        "spin": np.column_stack([spin, np.abs(spin), along + spin, np.abs(along + spin)]),
    }
    return {NOTHING: np.ones((len(block), 1))} | {k: standard(v) for k, v in groups.items()}


def _stretch(x: Array) -> Array:
    """Which of STRETCHES stretches of the set-up with as many places each a place is in."""
    return np.digitize(x, np.quantile(x, np.linspace(0.0, 1.0, STRETCHES + 1)[1:-1]))


def history_groups(release: Array, order: Array, began: Array) -> dict[str, Array]:
    """What happened before an impact: `order` of its release in the series, instant at which it `began`."""
    number = np.zeros(len(release))
    for r in np.unique(release):
        own = release == r
        number[own] = np.argsort(np.argsort(began[own]))
    groups = {"series": order[:, None], "history": np.column_stack([number, number == 0])}
    return {k: standard(v) for k, v in groups.items()}


def film_data(film: Film, seen: World) -> FilmData:
    """Cut a film into segments, in the world that `sanity` sees in it or that it states."""
    cut = cut_film(seen, film)
    basis = flight_basis(film, cut.flights)
    states = fit_states(seen, film, cut.flights, basis)
    start = start_instants(seen, cut, basis, states)
    impacts = find_impacts(seen, cut, basis, states, start)
    return FilmData(cut, basis, impacts, start, release_order(film.release_block).astype(float))
