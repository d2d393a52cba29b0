"""Models fitted to the segments of a film: robust maximum likelihood over flights and impacts at once.

What an impact leaves unexplained has three sources: the noise of the measured flights on both sides, the soil, which
varies from impact to impact (every parameter of the law by a standard deviation that is fitted, too), and the model's
error. The first two make the covariance of each impact; a Student distribution takes the odd impact that falls on the
other side of an edge. Flights are independent of it: coefficients of degree 2 and more, of unit variance.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from rock2d.diagnosis.model import BASE_WIDTH, Model, discrete, from_scale, scatters, to_scale
from rock2d.scene.world import World

Array = np.ndarray

HEAVY = 4.0  # degrees of freedom of the Student distribution of an impact
HEAVY_FLIGHT = 8.0  # and of a flight's coefficient
HOPELESS = 1e5  # chi-square of an impact beyond which it tells nothing more
STEP = 0.02  # of a parameter's scale, for differences
ROUNDS = 15
SHORT = 5  # rounds of fits that only look for the way
GRID = 9  # values of a parameter that are tried first
RESCANS = 3
ENOUGH = 0.2  # log likelihood below which a step is not worth it
LITTLE = 2.0  # and where some releases saw nothing in the effect
WORTH = 1.0  # log likelihood that an effect must gain on some releases to be looked for from where they led
PROMISING = 15.0  # log likelihood that an effect must gain before its parameters are looked at twice
FAR = 0.1  # way of a parameter after which noise is worked out anew
NEAR = 0.03  # way of any parameter within which slopes are those of the start
FEW = 100  # impacts with which the way to the best parameters is looked for
LEAP = 0.5  # farthest that a parameter of the base law follows a step of the grid
PRIOR_SCATTER = 0.3  # logarithmic standard deviation of the soil above which it becomes implausible


@dataclass
class Residuals:
    """Impacts (n, d) in SI; flights (m, 3, degrees) in units of noise. NaN where an impact cannot be simulated.

    d = 6 on film: along the ground and across it (m) and angle (rad), then their rates; in an impact table the rates
    alone.
    """

    impacts: Array
    flights: Array


class Data(Protocol):
    """Measured segments that models are fitted to: `film_data.FilmData` or `table_data.TableData`."""

    order: Array  # (releases,) place of each release in its block's series

    @property
    def impact_release(self) -> Array:
        """(n,) release of each impact."""

    @property
    def flight_release(self) -> Array:
        """(m,) release of each flight."""

    @property
    def impact_order(self) -> Array:
        """(n,) place of each impact's release in its series."""

    @property
    def impact_block(self) -> Array:
        """(n,) block of each impact."""

    @property
    def impact_zone(self) -> Array:
        """(n,) zone of each impact."""

    def only(self, releases: Array) -> Data:
        """The segments of some of the releases, given as a mask; releases keep their numbers."""

    def left(self, world: World, shift: Array | None = None) -> Residuals:
        """What a world leaves unexplained; `shift` (6,) or (n, 6) is added to the states before the impacts."""

    def incident(self, world: World) -> Array:
        """(n, 6) states before the impacts."""

    def state_noise(self, world: World) -> Array:
        """(n, 6, 6) covariance of the states before the impacts, in that world."""

    def outcome_noise(self) -> Array:
        """(n, d, d) covariance of the residuals of impacts from the measurement after them."""

    def extra_scatter(self) -> Array:
        """(n, d, k) directions of noise whose size is not known and is fitted with the soil's."""

    def impact_features(self, world: World) -> Array:
        """(n, features) what is known of each impact before it happens."""

    def impact_groups(self, world: World) -> dict[str, Array]:
        """Name -> (n, features): groups of what each impact may depend on, standardised."""

    def flight_groups(self, world: World) -> tuple[Array, dict[str, Array]]:
        """How much each flight (m,) bends under an acceleration; groups of what that may depend on, as above."""

    def flight_features(self, world: World) -> Array:
        """(m, features) what is known of each flight."""


def residuals(model: Model, p: Array, data: Data, shift: Array | None = None) -> Residuals:
    """Everything that the model at p leaves unexplained."""
    return data.left(model.world(p, data.impact_order), shift)


@dataclass
class Slopes:
    """Derivatives of the residuals: by parameters, by the state before (n, 6, 6), by the soil's scatter (n, 6, k)."""

    impacts: Array  # (n, 6, parameters)
    flights: Array  # (m, 3, degrees, parameters)
    scatter: Array
    covariance: Array  # (n, 6, 6) of measurement noise


def slopes(
    model: Model,
    p: Array,
    data: Data,
    at: Residuals,
    soil: Array,
    covariance: Array | None = None,
    known: Slopes | None = None,
) -> Slopes:
    """Derivatives at p by differences; `covariance` of measurement noise is worked out, at this scatter `soil`,
    unless given. `known`: derivatives at the same place by the first parameters."""
    (n, d), size = at.impacts.shape, model.size
    by_impacts, by_flights = np.zeros((n, d, size)), np.zeros((*at.flights.shape, size))
    _, high = model.bounds()
    first = 0
    if known is not None:
        first = known.impacts.shape[-1]
        by_impacts[..., :first], by_flights[..., :first] = known.impacts, known.flights
    fixed = {*scatters(model), *discrete(model)}
    for k in sorted(set(range(first, size)) - fixed):
        step = STEP if p[k] + STEP <= high[k] else -STEP
        ahead = residuals(model, p + step * (np.arange(size) == k), data)
        by_impacts[..., k] = (ahead.impacts - at.impacts) / step
        by_flights[..., k] = (ahead.flights - at.flights) / step
    columns = [by_impacts[..., : len(BASE_WIDTH)]]
    for i, effect in enumerate(model.effects):
        if effect.scatter:  # the same amount at every impact
            amounts = [list(v) for v in model.values(p)]
            amounts[i] = [from_scale(model.parameters[i][0], STEP)]
            moved = data.left(model.world(p, data.impact_order, amounts))
            columns.append(((moved.impacts - at.impacts) / STEP)[..., None])
    scatter = np.nan_to_num(np.concatenate([*columns, data.extra_scatter()], axis=-1))
    if covariance is None:
        covariance = _noise_covariance(model, p, data, at, soil)
    return Slopes(np.nan_to_num(by_impacts), by_flights, scatter, covariance)


def _noise_covariance(model: Model, p: Array, data: Data, at: Residuals, scatter: Array) -> Array:
    """(n, d, d) of the residuals, from the noise of the measured states before and after, and from what the soil's
    scatter (5,) does beyond its slope.

    To second order: near an edge of what may happen (a corner that lands just before or after another) the state
    before says less of the state after than its slope there promises. Of r = a x + b x² the variance is a² + 2 b² if x
    is normal.
    """
    before = data.state_noise(model.world(p, data.impact_order))
    sigma = np.sqrt(np.maximum(np.median(np.diagonal(before, axis1=1, axis2=2), axis=0), 1e-18))
    slope, bend = [], []
    for k in range(6):
        shift = sigma[k] * (np.arange(6) == k)
        ahead, behind = residuals(model, p, data, shift), residuals(model, p, data, -shift)
        slope.append((ahead.impacts - behind.impacts) / (2 * sigma[k]))
        bend.append((ahead.impacts + behind.impacts - 2 * at.impacts) / (2 * sigma[k] ** 2))
    by_state, by_square = (np.nan_to_num(np.stack(v, axis=-1)) for v in (slope, bend))
    own = 2.0 * np.diagonal(before, axis1=1, axis2=2) ** 2
    curved = []
    for k in range(len(BASE_WIDTH)):
        step = scatter[k] * (np.arange(model.size) == k)
        ahead, behind = residuals(model, p + step, data), residuals(model, p - step, data)
        curved.append((ahead.impacts + behind.impacts - 2 * at.impacts) / np.sqrt(2.0))
    by_soil = np.nan_to_num(np.stack(curved, axis=-1))
    return (
        by_soil @ by_soil.transpose(0, 2, 1)
        + by_state @ before @ by_state.transpose(0, 2, 1)
        + (by_square * own[:, None]) @ by_square.transpose(0, 2, 1)
        + data.outcome_noise()
    )


def spread(slope: Slopes, scatter: Array) -> Array:
    """(n, 6, 6) covariances at standard deviations `scatter` (k,) of the soil."""
    wide = slope.scatter * scatter
    return slope.covariance + wide @ wide.transpose(0, 2, 1)


def log_likelihood(r: Array, covariance: Array) -> Array:
    """(n,) of impacts; Student, to a constant. NaN rows count as very improbable."""
    d = r.shape[1]
    chi2 = chi_square(r, covariance)
    return -0.5 * np.linalg.slogdet(covariance)[1] - 0.5 * (HEAVY + d) * np.log1p(chi2 / HEAVY)


def chi_square(r: Array, covariance: Array) -> Array:
    """(n,) of impacts, at most HOPELESS, which is also what an impact that cannot be simulated gets."""
    tame = np.nan_to_num(r, nan=0.0, posinf=0.0, neginf=0.0)
    chi2 = np.einsum("ni,ni->n", tame, np.linalg.solve(covariance, tame[..., None])[..., 0])
    return np.where(np.isfinite(r).all(axis=1) & (chi2 < HOPELESS), chi2, HOPELESS)


def flight_log_likelihood(r: Array) -> Array:
    """(m,) of flights."""
    return -0.5 * (HEAVY_FLIGHT + 1) * np.log1p(r**2 / HEAVY_FLIGHT).sum(axis=(1, 2))


def fit_scatter(r: Array, slope: Slopes, start: Array) -> Array:
    """(k,) standard deviations of the soil that make the impacts most probable."""
    from scipy.optimize import minimize

    good = np.isfinite(r).all(axis=1)
    part = Slopes(slope.impacts, slope.flights, slope.scatter[good], slope.covariance[good])

    def cost(logs: Array) -> tuple[float, Array]:
        s = np.exp(logs)
        covariance = spread(part, s)
        inverse = np.linalg.inv(covariance)
        u = np.einsum("nij,nj->ni", inverse, r[good])
        chi2 = np.einsum("ni,ni->n", r[good], u)
        d = r.shape[1]
        value = 0.5 * np.linalg.slogdet(covariance)[1] + 0.5 * (HEAVY + d) * np.log1p(chi2 / HEAVY)
        weight = (HEAVY + d) / (HEAVY + chi2)
        trace = np.einsum("nik,nij,njk->nk", part.scatter, inverse, part.scatter)
        pull = np.einsum("nik,ni->nk", part.scatter, u) ** 2
        gradient = ((trace - weight[:, None] * pull) * s**2).sum(axis=0)
        return float(value.sum() + 0.5 * ((s / PRIOR_SCATTER) ** 2).sum()), gradient + (
            s / PRIOR_SCATTER
        ) ** 2

    bounds = [(np.log(1e-4), np.log(1.0))] * len(start)
    found = minimize(cost, np.log(start), jac=True, bounds=bounds, method="L-BFGS-B", options={"maxiter": 60})
    return np.exp(found.x)


@dataclass
class Fit:
    """A fitted model: parameters, their covariance, the soil's scatter, and what is left; `free` unless its parameters
    were found elsewhere."""

    model: Model
    p: Array
    p_covariance: Array
    scatter: Array
    slope: Slopes
    left: Residuals
    free: bool = True

    def covariance(self) -> Array:
        return spread(self.slope, self.scatter)

    def scores(self) -> tuple[Array, Array]:
        """Log likelihoods of impacts (n,) and flights (m,)."""
        return log_likelihood(self.left.impacts, self.covariance()), flight_log_likelihood(self.left.flights)

    def total(self) -> float:
        """Log likelihood of everything."""
        impacts, flights = self.scores()
        return float(impacts.sum() + flights.sum())

    def only(self, impacts: Array, flights: Array) -> Fit:
        """The fit as it is on some impacts and flights, given as masks."""
        s = self.slope
        slope = Slopes(s.impacts[impacts], s.flights[flights], s.scatter[impacts], s.covariance[impacts])
        return replace(
            self, slope=slope, left=Residuals(self.left.impacts[impacts], self.left.flights[flights])
        )


def some_releases(data: Data) -> Array:
    """(releases,) mask of as many releases, evenly from every series, as have about FEW impacts."""
    return data.order % max(1, len(data.impact_release) // FEW) == 0


def normal_equations(
    left: Residuals, slope: Slopes, covariance: Array, keep: tuple[Array, Array]
) -> tuple[Array, Array]:
    """Curvature (P, P) and slope (P,) of minus the log likelihood over the impacts and flights in `keep`."""
    impacts, flights = keep
    r = np.nan_to_num(left.impacts)
    good = impacts & np.isfinite(left.impacts).all(axis=1)
    inverse = np.linalg.inv(covariance[good])
    u = np.einsum("nij,nj->ni", inverse, r[good])
    chi2 = np.einsum("ni,ni->n", r[good], u)
    weight = (HEAVY + r.shape[1]) / (HEAVY + chi2)
    j = slope.impacts[good]
    curve = np.einsum("n,nip,nij,njq->pq", weight, j, inverse, j, optimize=True)
    grad = np.einsum("n,nip,ni->p", weight, j, u)
    rf, jf = left.flights[flights], slope.flights[flights]
    wf = (HEAVY_FLIGHT + 1) / (HEAVY_FLIGHT + rf**2)
    curve += np.einsum("mcd,mcdp,mcdq->pq", wf, jf, jf, optimize=True)
    grad += np.einsum("mcd,mcd,mcdp->p", wf, rf, jf)
    return curve, grad


def newton_step(curve: Array, grad: Array, p: Array, low: Array, high: Array) -> Array:
    """(P,) step to subtract from `p`; a parameter at its bound that would pass it stays, and the others go without."""
    free = ~(((p <= low) & (grad > 0.0)) | ((p >= high) & (grad < 0.0)))
    step = np.zeros_like(p)
    step[free] = np.linalg.solve(curve[np.ix_(free, free)], grad[free])
    return step


def prior(model: Model) -> tuple[Array, Array]:
    """Weak Gaussian prior: (centre, 1 / variance) of the parameters."""
    width = np.concatenate([BASE_WIDTH, np.full(model.size - len(BASE_WIDTH), 1.0)])
    return model.start(), width**-2.0


def scan(model: Model, data: Data, p: Array, covariance: Array, slope: Slopes | None) -> Array:
    """Parameters after a walk over a grid of each of the effects' parameters in turn.

    An effect can be so strong that the base law misses altogether where it acts, and no slope leads there. With the
    `slope` of a fit nearby the base law follows each step.
    """
    low, high = model.bounds()
    parameters = [q for own in model.parameters for q in own]
    n_base = len(BASE_WIDTH)
    centre, tight = prior(model)
    everything = np.ones(len(data.impact_release), bool), np.ones(len(data.flight_release), bool)

    def value(q: Array) -> tuple[float, Residuals]:
        left = residuals(model, q, data)
        impacts = log_likelihood(left.impacts, covariance).sum()
        return float(impacts + flight_log_likelihood(left.flights).sum()), left

    best, _ = value(p)
    for i, parameter in enumerate(parameters):
        k = n_base + i
        if k in scatters(model):
            continue
        grid = [to_scale(parameter, v) for v in parameter.choices] or np.linspace(low[k], high[k], GRID)
        start = p.copy()
        for z in grid:
            trial = start.copy()
            trial[k] = z
            own, left = value(trial)
            if own > best:
                best, p = own, trial
            if slope is None:
                continue
            base = Slopes(slope.impacts[..., :n_base], slope.flights[..., :n_base], slope.scatter, covariance)
            curve, grad = normal_equations(left, base, covariance, everything)
            grad += tight[:n_base] * (trial[:n_base] - centre[:n_base])
            step = np.linalg.solve(curve + np.diag(tight[:n_base]), grad)
            followed = trial.copy()
            followed[:n_base] = np.clip(
                trial[:n_base] - np.clip(step, -LEAP, LEAP), low[:n_base], high[:n_base]
            )
            after, _ = value(followed)
            if after > best:
                best, p = after, followed
    return p


def fit_effects(model: Model, data: Data, base: Fit) -> Fit:
    """Fit a model with more effects than `base` has (which come first).

    Some releases show the way (`explore`); from where it leads all of them are fitted. An effect that is worth it has
    its noise worked out anew: where the base is far off, so is the way in which it passes noise on.
    """
    start = np.concatenate([base.p, model.start()[len(base.p) :]])
    some = some_releases(data)
    if some.all():
        found = explore(model, data, base)
    else:
        part = base.only(some[data.impact_release], some[data.flight_release])
        way = explore(model, data.only(some), part)
        worth = way.total() > part.total() + WORTH
        found = fit(model, data, way.p if worth else start, old=base, enough=ENOUGH if worth else LITTLE)
    if found.total() > base.total() + PROMISING:
        found = fit(model, data, found.p)
    if found.total() < base.total():
        # what some releases liked the others do not: from the base, none can end below it
        found = max((found, fit(model, data, start, old=base, enough=LITTLE)), key=Fit.total)
    return found


def explore(model: Model, data: Data, base: Fit) -> Fit:
    """The best of the fits from `base`, and from where `scan` leads with the variance as it is and with ten times as
    much, which sees misses from afar; then again around the best, if it is worth it."""
    start = np.concatenate([base.p, model.start()[len(base.p) :]])
    starts = [start]
    for wide, slope in ((1.0, base.slope), (10.0, None)):
        found = scan(model, data, start, wide * base.covariance(), slope)
        if not any(np.allclose(found, p) for p in starts):
            starts.append(found)
    best = max((fit(model, data, p, old=base, rounds=SHORT) for p in starts), key=Fit.total)
    for _ in range(RESCANS if best.total() > base.total() + PROMISING else 0):
        again = scan(model, data, best.p, best.covariance(), best.slope)
        if np.allclose(again, best.p):
            break
        other = fit(model, data, again, old=best, rounds=SHORT)
        if other.total() < best.total() + 1.0:
            break
        best = other
    return best


def fit(model: Model, data: Data, start: Array | None = None, keep: tuple[Array, Array] | None = None,
        old: Fit | None = None, rounds: int = ROUNDS, enough: float = ENOUGH) -> Fit:  # fmt: skip
    """Fit a model to the impacts and flights in `keep` (two boolean arrays; all by default).

    `old`: a fit whose noise covariance and scatter are taken as a start, and its slopes while the fit is near it.
    """
    low, high = model.bounds()
    p = np.clip(model.start() if start is None else start, low, high)
    if keep is None:
        keep = np.ones(len(data.impact_release), bool), np.ones(len(data.flight_release), bool)
    centre, tight = prior(model)
    begin, left = p, residuals(model, p, data)
    own, extra = len(BASE_WIDTH) + len(model.scatter_effects), data.extra_scatter().shape[-1]
    scatter = np.full(own + extra, 0.05)
    if old is not None:
        known = len(old.scatter) - extra
        scatter[: min(known, own)] = old.scatter[: min(known, own)]
        scatter[own:] = old.scatter[known:]
    slope: Slopes | None = old.slope if old is not None else None
    damping = 1e-3
    near = (
        np.concatenate([old.p, model.start()[len(old.p) :]])
        if old is not None
        else np.full(model.size, np.inf)
    )

    def cost(r: Residuals, q: Array, covariance: Array) -> float:
        return float(
            -log_likelihood(r.impacts, covariance)[keep[0]].sum()
            - flight_log_likelihood(r.flights)[keep[1]].sum()
            + 0.5 * (tight * (q - centre) ** 2).sum()
        )

    curve = np.eye(model.size)
    for round in range(rounds):
        # the noise of a start far away is not that of the end
        stale = old is None and (round == 0 or (round == 2 and np.abs(p - begin).max() > FAR))
        noise = None if slope is None or stale else slope.covariance
        known = old.slope if old is not None and np.abs(p - near).max() < NEAR else None
        slope = slopes(model, p, data, left, scatter, noise, known)
        part = Slopes(
            slope.impacts[keep[0]], slope.flights, slope.scatter[keep[0]], slope.covariance[keep[0]]
        )
        scatter = fit_scatter(left.impacts[keep[0]], part, np.maximum(scatter, 3e-3))
        covariance = spread(slope, scatter)
        curve, grad = normal_equations(left, slope, covariance, keep)
        grad = grad + tight * (p - centre)
        grad[discrete(model)] = 0.0  # chosen, not fitted
        now = cost(left, p, covariance)
        gain = 0.0
        for _ in range(5):
            regular = curve + np.diag(tight + damping * np.diag(curve))
            ahead = np.clip(p - newton_step(regular, grad, p, low, high), low, high)
            if grad @ (p - ahead) < 0.2 * enough:  # a parabola promises half of it
                break
            trial = residuals(model, ahead, data)
            gain = now - cost(trial, ahead, covariance)
            if gain > 0.0:
                p, left = ahead, trial
                damping = max(damping / 10, 1e-6)
                break
            damping *= 10
        if gain < enough:
            break
    assert slope is not None
    for i, k in enumerate(scatters(model)):
        p[k] = scatter[len(BASE_WIDTH) + i]
    return Fit(model, p, np.linalg.inv(curve + np.diag(tight)), scatter, slope, left)
