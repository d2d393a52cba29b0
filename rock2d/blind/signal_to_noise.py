"""Signal-to-noise ratio of the hidden causes of a case, given noise, soil scatter and the free parameters of a fit.

Every release is simulated until shortly after its first impact: with and without the hidden causes, with each of the
five parameters of the law and each of the six components of its incident state changed, and without the scatter of the
soil. Statistics describe the recording of each run: position and velocity before and after the first impact, and
curvature of the first flight. Differences are divided by the standard deviations that noise and soil cause. What other
incident states imitate is projected out, and the parameters of the law are fitted: a block that lands on another corner
answers to any small change, so that a linear model of the law would miss what a fit imitates. The length of the
remaining vector is the signal-to-noise ratio: the size of the causes in standard errors of the best linear test."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rock2d.arrays import Array
from rock2d.blind import reality
from rock2d.blind.cases import Case

STATE_STEP = 0.003  # change of a component of the incident state, in units of the block's scale
# of the factors on the parameters of the law: a step as large as the scatter of a soil, so that most blocks answer
# smoothly; their bounds; most steps of their fit
LAW_STEP, LAW_BOUNDS, MOST_LAW_STEPS = 0.1, (0.3, 3.0), 12
WINDOW_AFTER_IMPACT = 3.0  # √(size / g): part of the flight after the first impact that is described
MOST_SIMULATED_RELEASES = 40  # the result is scaled to all releases
SOIL_DRAWS = 8  # draws of the soil from which the scatter is estimated
SHRINKAGE = 0.3  # share by which the covariance of the few draws is shrunk toward its diagonal
LARGEST_STATISTIC_SDS = 30.0  # limit of a statistic in standard deviations, beyond which the linear model fails
LAW_PARAMETERS = ("k_l", "k_ul", "k_t", "mu", "k_r")


def signals_to_noise(case: Case) -> tuple[float, list[float]]:
    """Signal-to-noise of the hidden causes of a case together, in the first flights and impacts of all releases, and of
    each cause: of the part of its signature that the other causes cannot imitate. Each signature is that of the cause
    alone: beside a cause that moves some statistics beyond their limit, the others would change alone, and that would
    look like a larger signal."""
    if not case.hidden:
        return 0.0, []
    sets = [[cause] for cause in case.hidden]
    found = signatures(case, sets if len(sets) == 1 else [*sets, case.hidden])
    alone, ratios = np.array(found[: len(sets)]), []
    for i, own in enumerate(alone):
        rest = np.delete(alone, i, axis=0).T
        ratios.append(float(np.linalg.norm(own - rest @ np.linalg.pinv(rest) @ own)))
    return float(np.linalg.norm(found[-1])), ratios


def signatures(case: Case, causes: Sequence[list[reality.Hidden]]) -> list[Array]:
    """The signature of each set of causes: changes of the statistics of all releases, in standard errors, without the
    part that a fit can imitate."""
    from scipy.optimize import least_squares

    chosen = np.flatnonzero(~case.heldout)
    releases, chosen = len(chosen), chosen[:: -(-len(chosen) // MOST_SIMULATED_RELEASES)]
    case = _some_releases(case, chosen)
    first_flights = _first_flights(case)
    noise = _Whitening.estimate(case, first_flights)
    incident = _incident_directions(case, first_flights, noise)

    def seen(factors: Array, hidden: list[reality.Hidden]) -> Array:
        law = case.world.law
        changed = {name: getattr(law, name) * x for name, x in zip(LAW_PARAMETERS, factors, strict=True)}
        changed["k_ul"] = max(changed["k_l"], changed["k_ul"])
        world = replace(case.world, law=replace(law, **changed))
        return first_flights.statistics(replace(case, world=world), hidden)

    def remaining(factors: Array, film: Array) -> Array:
        z = noise.whitened(film, seen(factors, []))
        return np.asarray(z - (incident @ (incident.transpose(0, 2, 1) @ z[..., None]))[..., 0]).ravel()

    out, known = [], np.ones(len(LAW_PARAMETERS))
    for cause in causes:
        film = seen(known, cause)
        fit = least_squares(
            remaining, known, loss="cauchy", diff_step=LAW_STEP, bounds=LAW_BOUNDS,
            max_nfev=MOST_LAW_STEPS, args=(film,),
        )  # fmt: skip
        out.append(fit.fun * np.sqrt(releases / len(chosen)))
    return out


def _some_releases(case: Case, chosen: Array) -> Case:
    releases = case.releases
    part = reality.Releases(releases.block_ids[chosen], releases.states[chosen], releases.order[chosen])
    return replace(case, releases=part, heldout=case.heldout[chosen])


def _sizes_m(case: Case) -> Array:
    """(releases,) diameter of the circle about each block."""
    return 2 * np.array([b.radius_m for b in case.world.blocks])[case.releases.block_ids]


@dataclass(frozen=True)
class _FirstFlights:
    """The part of the films that the statistics describe.

    Attributes
    ----------
    times_s : instants of the frames
    first_impact, window : (releases,) first frame after the first flight, and number of frames after it
    base : (releases, 15) statistics without causes"""

    times_s: Array
    first_impact: Array
    window: Array
    base: Array

    def statistics(self, case: Case, hidden: list[reality.Hidden], soil_sd: Array | None = None) -> Array:
        """(releases, 15) statistics of the films of a case without noise."""
        film = case.filmed(self.times_s, hidden, noisy=False, soil_sd=soil_sd)
        return _all_statistics(film, self.first_impact, self.window)


def _first_flights(case: Case) -> _FirstFlights:
    times = case.times_s
    film = case.filmed(times, [], noisy=False)
    first_impact = _first_impact(case, film, times)
    window = WINDOW_AFTER_IMPACT * np.sqrt(_sizes_m(case) / case.world.gravity_m_s2) * case.fps
    frames = window.astype(int)
    last = min(len(times), int((first_impact + frames).max()) + 2)
    base = _all_statistics(film[:, :last], first_impact, frames)
    return _FirstFlights(times[:last], first_impact, frames, base)


@dataclass(frozen=True)
class _Whitening:
    """Whitening of statistics.

    Attributes
    ----------
    sd : (releases, 15) standard deviations of the statistics by noise and soil
    inverse_root : (releases, 15, 15) inverse Cholesky factor of their correlations"""

    sd: Array
    inverse_root: Array

    @staticmethod
    def estimate(case: Case, first_flights: _FirstFlights) -> _Whitening:
        """Estimate from draws of the soil."""
        base = first_flights.base
        # the statistics are coefficients of orthonormal polynomials and have the noise of a frame; noise that is
        # correlated from frame to frame averages out less
        camera = case.camera
        correlated = np.sqrt((1.0 + camera.noise_correlation) / (1.0 - camera.noise_correlation))
        position = camera.position_noise_m
        noise = correlated * np.array([position, position, camera.angle_noise_rad] * 5)
        without_scatter = first_flights.statistics(case, [], soil_sd=np.zeros(5))
        others = [first_flights.statistics(replace(case, seed=case.seed + k), []) for k in range(1, SOIL_DRAWS)]
        scattered = np.array([base, *others]) - without_scatter
        # the soil may scatter a release at the edge of a facet much more than other releases of the block
        soil = np.empty_like(base)
        block_ids = case.releases.block_ids
        for b in np.unique(block_ids):
            own, square = block_ids == b, scattered[:, block_ids == b] ** 2
            soil[own] = np.sqrt(np.maximum(square.mean(axis=0), square.mean(axis=(0, 1))))
        sd = np.hypot(noise, soil)
        # the soil changes all statistics of a release together
        z = (scattered / sd).transpose(1, 0, 2)
        covariance = (1.0 - SHRINKAGE) * z.transpose(0, 2, 1) @ z / len(z[0])
        rest = np.maximum(1.0 - np.diagonal(covariance, axis1=1, axis2=2), 0.0)
        root = np.linalg.cholesky(covariance + np.eye(base.shape[1]) * rest[:, None, :])
        return _Whitening(sd, np.linalg.inv(root))

    def whitened(self, statistics: Array, others: Array) -> Array:
        """Differences between statistics, in standard errors."""
        z = np.clip((statistics - others) / self.sd, -LARGEST_STATISTIC_SDS, LARGEST_STATISTIC_SDS)
        return np.asarray((self.inverse_root @ z[..., None])[..., 0])


def _incident_directions(case: Case, first_flights: _FirstFlights, noise: _Whitening) -> Array:
    """(releases, 15, 6) orthonormal directions that the incident state of a release can imitate."""
    size = _sizes_m(case)
    pace = np.sqrt(case.world.gravity_m_s2 * size)
    units = STATE_STEP * np.column_stack([size, size, np.ones_like(size), pace, pace, pace / size])
    changes = []
    for k in range(6):
        states = case.releases.states + units * (np.arange(6) == k)
        changed = replace(case, releases=replace(case.releases, states=states))
        changes.append(noise.whitened(first_flights.statistics(changed, []), first_flights.base))
    directions, _ = np.linalg.qr(np.stack(changes, axis=-1))
    return np.asarray(directions)


def _first_impact(case: Case, film: Array, times: Array) -> Array:
    """(releases,) first frame after the first free flight."""
    t = times[:, None]
    x, v = case.releases.states[:, None, :3], case.releases.states[:, None, 3:]
    parabola = x + v * t - 0.5 * case.world.gravity_m_s2 * t**2 * np.array([0.0, 1.0, 0.0])
    radius = np.array([b.radius_m for b in case.world.blocks])[case.releases.block_ids][:, None]
    off = np.hypot(film[..., 0] - parabola[..., 0], film[..., 1] - parabola[..., 1]) > 1e-3 * radius
    return np.where(off.any(axis=1), off.argmax(axis=1), len(times) - 1)


def _all_statistics(films: Array, first_impact: Array, window: Array) -> Array:
    """(releases, 15) statistics of the films (releases, frames, 3)."""
    parts = zip(films, first_impact, window, strict=True)
    return np.array([_statistics(film, impact, frames) for film, impact, frames in parts])


def _statistics(film: Array, impact: int, window: int) -> Array:
    """(15,) mean, slope and curvature of x, y, theta before the impact; mean and slope in the second half of the
    window after it."""
    before, after = film[:impact], film[impact + window // 2 : impact + window + 2]
    first = _basis(len(before), 2).T @ before if len(before) > 4 else np.zeros((3, 3))
    second = _basis(len(after), 1).T @ after if len(after) > 2 else np.zeros((2, 3))
    return np.concatenate([first.ravel(), second.ravel()])


def _basis(n: int, degree: int) -> Array:
    t = np.linspace(-1.0, 1.0, n)
    q, r = np.linalg.qr(np.vander(t, degree + 1, increasing=True))
    return q * np.sign(np.diag(r))
