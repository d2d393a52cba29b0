"""Gravity measured in the flights of a film, with its error. It shows errors of lengths or times of the film.

Frame k of a flight shows p + v t + a t²/2 with two errors: one of the position, of standard deviation σ in each axis,
and one of the instant, τ (frames are not evenly spaced), which shifts the block along its path by its speed. So its
covariance is C = σ² 1 + τ² v vᵀ. Both variances are estimated from the residuals of all flights, and each flight is
fitted by generalised least squares. Of n even frames over a time T without τ, a has the standard error σ √(720/n) / T².

Errors that change slowly (compression, a lens, drag) do not average out over the frames. They appear in the next higher
polynomials: if the coefficients of degree 3 and 4 are clearly larger than the rest, only these give the variance.

An offset that is proportional to the speed, for example by blur if one side of the block is darker, bends all flights
in the same way: it neither averages out nor appears in the residuals. Its size is known (`Film.smear_offset_s`), and
its effect is added to the error.

Flights are combined within each release, and then releases. If releases disagree by more than their errors explain
(blocks at different distances from the camera), a scatter between them is added: Paule and Mandel (1982), Journal of
Research of the National Bureau of Standards 87(5), 377-385."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rock2d.arrays import Array
from rock2d.kinematics.flights import SMALLEST_NOISE, Film, Flights
from rock2d.kinematics.window_gravity import AGREEING_SPREAD, CLEAR_CURVATURE, GRAVITY_RATIO, LEAST_FALL_SLOPE
from rock2d.records.columns import POSITION, X, Y
from rock2d.statistics import NORMAL_95, student, weighted_median

PARABOLA_TERMS = 3  # polynomials of a parabola
SLOW_DEGREES = 2  # largest number of polynomials of the next higher degrees
VARIANCE_ROUNDS = 5  # most iterations of the estimate of σ and τ
CONVERGED_VARIANCE = 0.01  # relative change of the variances at which the iteration ends
SLOW_CHANCE, SCATTER_CHANCE = 0.05, 0.1  # significance levels of slow errors, and of scatter between flights
CLEAR_JITTER = 1.0  # smallest τ² that is used, in its standard errors
# frames left out at an end next to a contact, at most one of so many
EDGE_FRAMES, FRAMES_PER_EDGE_FRAME = 3, 16
OUTLYING_ERRORS = 6.0  # distance in standard errors at which a flight counts as an outlier


@dataclass(frozen=True)
class Measured:
    """A value with its standard error, scaled by Student's distribution so that value ± 1.96 errors is the 95 %
    interval."""

    value: float
    error: float

    @property
    def ci95(self) -> tuple[float, float]:
        return self.value - NORMAL_95 * self.error, self.value + NORMAL_95 * self.error

    def off(self, expected: float) -> bool:
        """Whether the value differs from the expected one by more than 3 standard errors."""
        return abs(self.value - expected) > 3.0 * self.error


@dataclass(frozen=True)
class FlightGravity:
    """Gravity measured in the flights of a film.

    Attributes
    ----------
    gravity_m_s2 : size of the acceleration in flight
    tilt_rad : angle of the image against the vertical, counter-clockwise
    used : (flights,) whether a flight is used; others are too straight, or outliers
    each, each_error : (flights,) acceleration of each flight along their mean and its standard error, in m/s²
    weight : (flights,) weight of each flight in the result, 0 if it is not used
    speed_velocity : (flights, 2) mean of speed × velocity over the flight in m²/s², weighted like an acceleration in
        the fit of the parabola
    noise_m, instant_noise_s : σ and τ
    slow : whether slowly changing errors give the standard error"""

    gravity_m_s2: Measured
    tilt_rad: Measured
    used: Array
    each: Array
    each_error: Array
    weight: Array
    speed_velocity: Array
    noise_m: float
    instant_noise_s: float
    slow: bool


def flight_gravity(film: Film, flights: Flights, stated_m_s2: float) -> FlightGravity | None:
    """Gravity from the flights of a film, as recorded; None if no flight shows it clearly.

    `stated_m_s2`: expected gravity, which distinguishes falls from other smooth motion."""
    paths = [_Path(film.t_s[a:b], film.pose[a:b, POSITION]) for a, b in zip(*_inner(film, flights), strict=True)]
    if not paths:
        return None
    every = _fitted(paths)
    used = _are_falls(every, stated_m_s2)
    if not used.any():
        return None
    fits = _fitted([path for path, use in zip(paths, used, strict=True) if use])
    mean = np.linalg.solve(
        (precision := np.linalg.inv(fits.covariance)).sum(axis=0), np.einsum("nij,nj->i", precision, fits.acceleration)
    )
    down = mean / np.hypot(*mean)
    aside = np.array([-down[Y], down[X]])  # to which a counter-clockwise turn of the picture turns `down`
    size, error = _along(fits, down)
    turn, turn_error = (values / np.hypot(*mean) for values in _along(fits, aside))
    # a film that falls upwards is mirrored, not turned
    turn += np.arctan2(down[X] * np.sign(-down[Y]), abs(down[Y]))
    release = flights.release[used]
    weight = np.zeros(len(used))
    gravity, weight[used] = _combined_over_releases(size, error, release, fits.freedom)
    tilt, _ = _combined_over_releases(turn, turn_error, release, fits.freedom)
    smear, drag = _smear_and_drag_responses(paths)
    smeared = film.smear_offset_s * smear
    shared = abs(float(weight @ smeared))  # equal in all flights
    each, each_error = _along(every, down)
    return FlightGravity(
        Measured(gravity.value, float(np.hypot(gravity.error, shared))),
        Measured(tilt.value, float(np.hypot(tilt.error, shared / np.hypot(*mean)))),
        used, each, np.hypot(each_error, smeared), weight, drag,
        fits.noise_m, fits.instant_noise_s, fits.slow,
    )  # fmt: skip


def _inner(film: Film, flights: Flights) -> tuple[Array, Array]:
    """First and last (exclusive) frame of each flight without frames next to a contact: a contact too weak to be seen
    in single frames still bends the ends of flights."""
    begin, end = (np.searchsorted(film.release, flights.release, side=side) for side in ("left", "right"))
    margin = np.minimum(EDGE_FRAMES, (flights.last - flights.first) // FRAMES_PER_EDGE_FRAME)
    return flights.first + margin * (flights.first > begin), flights.last - margin * (flights.last < end)


class _Path(NamedTuple):
    """Frames of one flight: instants (n,), positions (n, 2)."""

    t_s: Array
    position: Array


class _Fits(NamedTuple):
    """Fitted flights: acceleration (m, 2) with covariance (m, 2, 2), velocity in the middle (m, 2); what the film has
    in common: σ, τ, degrees of freedom of the errors, whether slow errors decide."""

    acceleration: Array
    covariance: Array
    velocity: Array
    noise_m: float
    instant_noise_s: float
    freedom: float
    slow: bool


class _Whitened(NamedTuple):
    """One flight with unit variance: coefficients (2 axes × 3 degrees, in the flight's own time from -1 to 1), their
    covariance, residuals along and across the path (2, n) in m, shares of the variance that the fit leaves them (2, n),
    speeds (n,), and squares of all residuals and of the slow polynomials with the number of these."""

    coefficients: Array
    covariance: Array
    residuals: Array
    left: Array
    speed: Array
    squares: float
    slow_squares: float
    slow_count: int


def _fitted(paths: list[_Path]) -> _Fits:
    """All flights, with the variances that their residuals show."""
    variance, jitter = 1.0, 0.0
    flights: list[_Whitened] = []
    for _ in range(VARIANCE_ROUNDS):
        before: list[Array | None] = [f.coefficients for f in flights] if flights else [None] * len(paths)
        flights = [_whitened(p, variance, jitter, c) for p, c in zip(paths, before, strict=True)]
        known = np.array([variance, jitter])
        variance, jitter = _variances(flights, variance, jitter)
        if np.allclose([variance, jitter], known, rtol=CONVERGED_VARIANCE, atol=0.0):
            break
    freedom = float(sum(2 * len(p.t_s) - 2 * PARABOLA_TERMS for p in paths) - 1 - (jitter > 0))
    squares, slow_squares, slow_count = (
        sum(values)
        for values in zip(
            *((own.squares, own.slow_squares, own.slow_count) for own in flights), (0.0, 0.0, 0), strict=True
        )
    )
    factor, slow = squares / max(freedom, 1.0), False
    if _significant(slow_squares, slow_count, squares - slow_squares, freedom - slow_count):
        factor, freedom, slow = slow_squares / slow_count, float(slow_count), True
    half = np.array([np.ptp(p.t_s) / 2 for p in paths])
    c = np.array([own.coefficients for own in flights]).reshape(-1, 2, PARABOLA_TERMS)
    covariance = np.array([own.covariance[2::PARABOLA_TERMS, 2::PARABOLA_TERMS] for own in flights]).reshape(-1, 2, 2)
    return _Fits(
        2 * c[:, :, 2] / half[:, None] ** 2,
        factor * covariance * (2 / half**2)[:, None, None] ** 2,
        c[:, :, 1] / half[:, None],
        float(np.sqrt(variance)),
        float(np.sqrt(jitter)),
        freedom,
        slow,
    )


def _own_time(t_s: Array) -> Array:
    return (t_s - t_s.mean()) / (np.ptp(t_s) / 2)


def _whitened(path: _Path, variance: float, jitter: float, before: Array | None) -> _Whitened:
    """One flight by generalised least squares; `before`: its coefficients, from which the velocities come."""
    s, n = _own_time(path.t_s), len(path.t_s)
    if before is None:
        before = np.polynomial.polynomial.polyfit(s, path.position, 2).T
    velocity = (before[:, 1:2] + 2 * before[:, 2:] * s).T / (np.ptp(path.t_s) / 2)
    speed = np.hypot(*velocity.T)
    ahead = np.divide(velocity, speed[:, None], out=np.tile([1.0, 0.0], (n, 1)), where=speed[:, None] > 0)
    slow = int(np.clip((n - PARABOLA_TERMS) // 2, 0, SLOW_DEGREES))
    powers = np.polynomial.legendre.legvander(s, PARABOLA_TERMS - 1 + slow)
    powers[:, :PARABOLA_TERMS] = np.vander(s, PARABOLA_TERMS, increasing=True)
    axes = np.stack([ahead, np.column_stack([-ahead[:, Y], ahead[:, X]])])  # along and across
    sd = np.sqrt([variance + jitter * speed**2, np.full(n, variance)])

    def rows(columns: Array) -> Array:
        """(2n, 2k) columns for x, then for y, along and across the path with unit variance."""
        sides = [np.hstack([axis[:, c : c + 1] * columns for c in (X, Y)]) for axis in axes]
        return np.concatenate([side / own[:, None] for side, own in zip(sides, sd, strict=True)])

    design = rows(powers[:, :PARABOLA_TERMS])
    seen = np.concatenate([(axis * path.position).sum(axis=1) / own for axis, own in zip(axes, sd, strict=True)])
    q, r = np.linalg.qr(np.hstack([design, rows(powers[:, PARABOLA_TERMS:])]))
    fit = 2 * PARABOLA_TERMS
    inverse = np.linalg.inv(r[:fit, :fit])
    projected = q.T @ seen
    residual = seen - q[:, :fit] @ projected[:fit]
    return _Whitened(
        (inverse @ projected[:fit]).reshape(2, PARABOLA_TERMS), inverse @ inverse.T, residual.reshape(2, n) * sd,
        1.0 - (q[:, :fit] ** 2).sum(axis=1).reshape(2, n), speed, float(residual @ residual),
        float((projected[fit:] ** 2).sum()), 2 * slow,
    )  # fmt: skip


def _variances(flights: list[_Whitened], variance: float, jitter: float) -> tuple[float, float]:
    """σ² and τ² from the residuals: their squares are σ² across the path and σ² + τ² v² along it."""
    squares = np.concatenate([own.residuals.ravel() ** 2 for own in flights])
    left = np.maximum(np.concatenate([own.left.ravel() for own in flights]), 1e-6)
    speed = np.concatenate([np.append(own.speed, np.zeros_like(own.speed)) for own in flights])
    design = np.column_stack([np.ones_like(speed), speed**2])
    weight = left**2 / (design @ [variance, jitter]) ** 2
    least = SMALLEST_NOISE**2
    alone = max(float((weight * squares / left).sum() / weight.sum()), least)
    normal = design.T @ (weight[:, None] * design)
    if np.linalg.cond(normal / np.sqrt(np.outer(np.diag(normal), np.diag(normal)) + 1e-300)) > 1e8:
        return alone, 0.0
    inverse = np.linalg.inv(normal)
    own, other = inverse @ (design.T @ (weight * squares / left))
    # the variance of a square is 2 of its mean squared
    clear = other > CLEAR_JITTER * np.sqrt(2.0 * inverse[1, 1])
    return (max(float(own), least), float(other)) if clear else (alone, 0.0)


def _significant(slow: float, slow_count: int, fast: float, fast_count: float) -> bool:
    """Whether the slow residuals are larger than the others by more than chance."""
    from scipy.special import fdtrc

    if slow_count < 1 or fast_count < 1 or fast <= 0.0:
        return False
    ratio = slow / slow_count / (fast / fast_count)
    return bool(fdtrc(slow_count, fast_count, ratio) < SLOW_CHANCE)


def _along(fits: _Fits, axis: Array) -> tuple[Array, Array]:
    """(m,) component of each acceleration along an axis (2,), with its standard error."""
    return fits.acceleration @ axis, np.sqrt(np.einsum("i,nij,j->n", axis, fits.covariance, axis))


def _are_falls(fits: _Fits, stated_m_s2: float) -> Array:
    """(m,) whether flights are falls.

    If gravity would clearly bend the path, it must be bent. Steep paths are steeper than any ground. The noise of other
    flights allows no such test; they must be clear all together. The choice of the test does not depend on the measured
    acceleration, which would bias the result."""
    down = np.array([0.0, -1.0 if np.median(fits.acceleration[:, Y]) < 0 else 1.0])
    size, error = _along(fits, down)
    vx, vy = fits.velocity.T
    ax, ay = fits.acceleration.T
    bend = np.abs(vx * ay - vy * ax) / np.maximum(np.hypot(vx, vy), 1e-12)
    expected = stated_m_s2 * np.abs(vx) / np.maximum(np.hypot(vx, vy), 1e-12)
    testable = expected > 2.0 * CLEAR_CURVATURE * error
    steep = (stated_m_s2 > 2.0 * CLEAR_CURVATURE * error) & (np.abs(vy) > LEAST_FALL_SLOPE * np.abs(vx)) & ~testable
    blurred = ~testable & ~steep
    clear = steep | (testable & (bend > CLEAR_CURVATURE * error))
    near = clear & (size > GRAVITY_RATIO[0] * stated_m_s2) & (size < GRAVITY_RATIO[1] * stated_m_s2)
    own = (near if near.any() else clear) | blurred
    if not own.any():
        return own
    middle = weighted_median(size[own], 1.0 / (error[own] ** 2 + (AGREEING_SPREAD * size[own] / 3) ** 2))
    used = own & (np.abs(size - middle) < AGREEING_SPREAD * middle + OUTLYING_ERRORS * error)
    together = CLEAR_CURVATURE * float((error[used] ** -2.0).sum()) ** -0.5 < middle if used.any() else False
    possible = clear.any() or GRAVITY_RATIO[0] * stated_m_s2 < middle < GRAVITY_RATIO[1] * stated_m_s2
    return used & bool(together and possible)


def _combined_over_releases(values: Array, errors: Array, release: Array, freedom: float) -> tuple[Measured, Array]:
    """Mean over releases (over flights if there is a single release) with its error, and the weight of each flight."""
    names, index = np.unique(release, return_inverse=True)
    if len(names) == 1:
        names = index = np.arange(len(values))
    total = np.bincount(index, errors**-2.0)
    mean, error, weight, scattered = _combined(np.bincount(index, values * errors**-2.0) / total, total**-0.5)
    if scattered:
        freedom = len(names) - 1
    return Measured(mean, error * student(freedom)), weight[index] * errors**-2.0 / total[index]


def _combined(values: Array, errors: Array) -> tuple[float, float, Array, bool]:
    """Weighted mean, its error, the weights (n,), and whether the values disagree; if they do, with an added scatter
    that makes chi-square their number minus one."""
    from scipy.optimize import brentq
    from scipy.special import chdtrc

    def disagreement(scatter: float) -> float:
        weight = 1.0 / (errors**2 + scatter)
        mean = (weight * values).sum() / weight.sum()
        return float((weight * (values - mean) ** 2).sum()) - (len(values) - 1)

    scatter = 0.0
    if len(values) > 1 and chdtrc(len(values) - 1, disagreement(0.0) + len(values) - 1) < SCATTER_CHANCE:
        scatter = float(brentq(disagreement, 0.0, 10.0 * np.ptp(values) ** 2))
    weight = 1.0 / (errors**2 + scatter)
    total = float(weight.sum())
    return float((weight * values).sum()) / total, total**-0.5, weight / total, scatter > 0.0


def _smear_and_drag_responses(paths: list[_Path]) -> tuple[Array, Array]:
    """(m,) apparent acceleration of each flight in 1/s, per second of an offset that is proportional to the speed; and
    (m, 2) `FlightGravity.speed_velocity`: a force that changes within a flight enters the fit of the parabola with the
    weight (1 - s²)², with the time s from -1 to 1."""
    smear, drag = np.zeros(len(paths)), np.zeros((len(paths), 2))
    for i, path in enumerate(paths):
        s, half = _own_time(path.t_s), np.ptp(path.t_s) / 2
        c = np.polynomial.polynomial.polyfit(s, path.position, 2)
        rate = c[1] + 2 * c[2] * s[:, None]
        smear[i] = 2 * np.polynomial.polynomial.polyfit(s, np.hypot(*rate.T) / half, 2)[2] / half**2
        velocity, weight = rate / half, np.maximum(1.0 - s**2, 0.0) ** 2
        drag[i] = (weight[:, None] * np.hypot(*velocity.T)[:, None] * velocity).sum(axis=0) / weight.sum()
    return smear, drag
