"""Fits of a model with one more effect than a known fit: their start, and when they end.

An effect can be so strong that the residuals of the known fit have no useful slope towards it. So grids of its
parameters are tried first, on some of the releases."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rock2d.arrays import Array
from rock2d.diagnosis.data import Data, Residuals
from rock2d.diagnosis.derivatives import Jacobian
from rock2d.diagnosis.fitting import FEW_ROUNDS, Convergence, Fit, extended, fit, some_releases
from rock2d.diagnosis.likelihood import LARGEST_CHI_SQUARE, chi_square, normal_equations, prior, total_log_likelihood
from rock2d.diagnosis.model import BASE_WIDTH, LARGEST_LOG_K_L, Model, choice_positions, scatter_positions, to_scale

BASE_STARTS = 2  # places from which the law is fitted
WIDE_SCAN = 10.0  # factor on the variance of the second scan
# Share of the impacts that the widest covariance brings within one standard error, and the factor that this must take.
# The factor is then narrowed by these powers.
SEEN_SHARE, FAR_MISFIT, NARROWING = 0.8, 1e3, (1.0, 2.0 / 3.0, 1.0 / 3.0)
WIDE_STARTS = 2  # places from which it is narrowed
MOST_WIDE_POINTS = 6  # binary logarithm of the largest number of places that are tried
SCAN_VALUES = 9  # tried values of a parameter in a scan
MOST_RESCANS = 3
RESCAN_GAIN = 1.0  # log likelihood that a further scan must gain
# gain in log likelihood of a step below which a fit has converged if its effect gained nothing on some releases
COARSE_CONVERGED_GAIN = 8.0
EXPLORED_GAIN = 1.0  # log likelihood of an effect on some releases for the fit to start from there
REFIT_GAIN = 15.0  # log likelihood that counts as much: what gains it is scanned or fitted again
LARGEST_BASE_STEP = 0.5  # largest change of a parameter of the base law with a step of a scan


def total_on_some(base: Fit, data: Data) -> float:
    """Log likelihood of the releases on which effects are explored, under a base that is fitted to these alone."""
    some = some_releases(data)
    if some.all():
        return base.total()
    part = base.only(some, data)
    return _short_fit(CachedResiduals(base.model, data.only(some).coarse()), part.p, part).total()


class Explored(NamedTuple):
    """Result of exploring an effect on some releases.

    Attributes
    ----------
    p : parameters from which the fit to all releases starts
    gain : gain in log likelihood of the effect on these releases
    useful : whether the fit starts at the explored parameters; if not, p is the known fit with a neutral effect"""

    p: Array
    gain: float
    useful: bool


def explore_on_some(model: Model, data: Data, base: Fit, on_some: float = -np.inf) -> Explored:
    """Explore a model with more effects than `base` has (which come first), on some releases.

    `on_some`: `total_on_some` of the base, which gains, too, if it is fitted to some releases; without it, the fit to
    all releases starts at the explored parameters whatever they gain."""
    some = some_releases(data)
    if some.all():
        best = _best_short_fit(model, data.coarse(), base)
        return Explored(best.p, best.total() - on_some, True)
    part = base.only(some, data)
    best = _best_short_fit(model, data.only(some).coarse(), part)
    gain = best.total() - on_some
    useful = gain > EXPLORED_GAIN or _must_choose(model)
    return Explored(best.p if useful else extended(base, model), gain, useful)


def fit_effects(model: Model, data: Data, base: Fit, found: Explored, rival_total: float = -np.inf) -> Fit:
    """Fit a model with more effects than `base` has (which come first) to all releases, from the explored parameters.

    `rival_total`: log likelihood that another effect will reach, see `Convergence`."""
    coarse = Convergence(COARSE_CONVERGED_GAIN, rival_total)
    fitted = fit(
        model, data, found.p, old=base, convergence=Convergence(rival_total=rival_total) if found.useful else coarse
    )
    return not_below(fitted, base, data, coarse)


def not_below(fitted: Fit, base: Fit, data: Data, convergence: Convergence) -> Fit:
    """The fit of a model with more effects than `base` has (which come first), fitted again from `base` if it ended
    below it: parameters that were found on some releases, or by a linear model, need not fit all. A fit that starts at
    the base gains from there; only where the noise of the base was computed elsewhere may it still end below it."""
    if fitted.total() >= base.total() or _must_choose(fitted.model):
        return fitted
    other = fit(fitted.model, data, extended(base, fitted.model), old=base, convergence=convergence)
    return max((fitted, other), key=Fit.total)


def _best_short_fit(model: Model, data: Data, base: Fit) -> Fit:
    """The best of several short fits: from `base`, and from two scans around it. One scan has a larger variance, which
    reacts to large residuals; see also `narrowed_starts`. An effect with optional parameters is also explored without
    them: a scan of all can end at a pair of wrong values. For an effect with a compulsory choice, fits from a grid of
    the law follow, because `base` has adapted to the other choice. If the best fit gains enough, scans around it
    follow.

    The fits keep the derivatives of `base`: they only provide a start."""
    start, cached = extended(base, model), CachedResiduals(model, data)
    starts = [] if _must_choose(model) else [start]
    for wide, jacobian in ((1.0, base.jacobian), (WIDE_SCAN, None)):
        p = scan(cached, start, wide * base.covariance(), jacobian)
        if not any(np.allclose(p, other) for other in [start, *starts]):
            starts.append(p)
    starts += narrowed_starts(model, data, base) + _starts_without_refinement(model, data, base)
    fits = [_short_fit(cached, p, base) for p in starts]
    fits += [fit(model, data, p, convergence=FEW_ROUNDS) for p in _starts_with_choices(model, data)]
    best = max(fits, key=Fit.total)
    for _ in range(MOST_RESCANS if best.total() > base.total() + REFIT_GAIN else 0):
        again = scan(cached, best.p, best.covariance(), best.jacobian)
        if np.allclose(again, best.p):
            break
        other = _short_fit(cached, again, best)
        if other.total() < best.total() + RESCAN_GAIN:
            break
        best = other
    return best


def narrowed_starts(model: Model, data: Data, base: Fit) -> list[Array]:
    """Ends of short fits with covariances that are wide at first, as starts; none if `base` is near most impacts.

    The likelihood is nearly the same for all impacts that are many standard errors away, so it does not show a fit the
    way to them. A wide covariance does. The fits begin at the best of some points of the last effect's parameters."""
    covariance, r = base.covariance(), base.residuals.impacts
    simulated = np.isfinite(r).all(axis=1)
    chi2 = chi_square(r[simulated], covariance[simulated], np.inf)
    misfit = np.quantile(chi2, SEEN_SHARE) / r.shape[1] if len(chi2) else 0.0
    own = sorted({*range(len(base.p), model.size)} - {*scatter_positions(model), *choice_positions(model)})
    if not (misfit > FAR_MISFIT and own):
        return []
    start = extended(base, model)
    points = [start, *_spread_points(model, start, own)]
    totals = [total_log_likelihood(model.residuals(p, data), misfit * covariance) for p in points]
    starts = [points[k] for k in np.argsort(totals)[-WIDE_STARTS:]]
    for power in NARROWING:
        noise = base.jacobian.noise._replace(covariance=misfit**power * covariance)
        wide = replace(base, jacobian=replace(base.jacobian, noise=noise))
        starts = [fit(model, data, p, wide, FEW_ROUNDS).p for p in starts]
    return starts


def _spread_points(model: Model, start: Array, own: Sequence[int]) -> list[Array]:
    """`start` with other values of the parameters at the positions `own`, spread evenly over their bounds: Sobol (1967,
    USSR Comput. Math. Math. Phys. 7(4), 86-112)."""
    from scipy.stats.qmc import Sobol  # takes over a second to import

    shares = Sobol(len(own), seed=0).random_base2(min(2 + len(own), MOST_WIDE_POINTS))
    low, high = model.bounds()
    points = np.tile(start, (len(shares), 1))
    points[:, own] = low[own] + shares * (high - low)[own]
    return list(points)


def _starts_without_refinement(model: Model, data: Data, base: Fit) -> list[Array]:
    """The best short fit of the last effect with its optional parameters neutral, if it has any, as a start."""
    last = model.effects[-1]
    plain = replace(model, effects=[*model.effects[:-1], last.without_refinement()])
    if plain.size == model.size:
        return []
    start, kept = model.start(), np.ones(model.size, bool)
    kept[model.positions[last.name]] = [not q.optional for q in last.parameters]
    start[kept] = _best_short_fit(plain, data, base).p
    return [start]


def _must_choose(model: Model) -> bool:
    """Whether the last effect is a choice without a neutral one. Then the law is always fitted with a choice: it may
    gain beside another effect only."""
    return any(q.must_choose for q in model.parameters[-1])


def _starts_with_choices(model: Model, data: Data) -> list[Array]:
    """`grid_starts` with each choice of the effects with a compulsory choice; none without such an effect."""
    neutral = model.start()[len(BASE_WIDTH) :]
    parameters = [q for own in model.parameters for q in own]
    choices = [(k, to_scale(q, v)) for k, q in enumerate(parameters) if q.must_choose for v in q.choices]
    chosen = [np.where(np.arange(len(neutral)) == k, z, neutral) for k, z in choices]
    if not len(data.impact_release):  # flights do not show the law
        return [np.concatenate([model.start()[: len(BASE_WIDTH)], own]) for own in chosen]
    return grid_starts(model, data, chosen)


def grid_starts(model: Model, data: Data, of_effects: Sequence[Array]) -> list[Array]:
    """The BASE_STARTS points of a grid of the law that miss least, each with one of the parameters `of_effects`."""
    corners = [
        np.array([min(stiffness, LARGEST_LOG_K_L), restitution, stiffness, friction, 0.0, *rest])
        for rest in of_effects
        for stiffness in (0.0, -2.0, 2.0, 4.0)
        for restitution in (0.0, -0.7, 0.7)
        for friction in (0.0, -0.5, 0.5)
    ]
    if not corners:
        return []
    residuals = [model.residuals(p, data).impacts for p in corners]
    # channels in units of their median residual over all corners
    scale = np.nanmedian(np.abs(np.concatenate(residuals)), axis=0)
    scale[scale == 0.0] = 1.0  # channels that were not measured
    misfit = [np.log1p(np.nan_to_num(np.abs(r) / scale, nan=LARGEST_CHI_SQUARE)).sum() for r in residuals]
    return [corners[i] for i in np.argsort(misfit)[:BASE_STARTS]]


def _short_fit(cached: CachedResiduals, start: Array, base: Fit) -> Fit:
    return fit(
        cached.model, cached.data, start, base, FEW_ROUNDS, keep_jacobian=True, residuals=cached.residuals(start)
    )


class CachedResiduals:
    """Residuals of a model, simulated once at each p."""

    def __init__(self, model: Model, data: Data) -> None:
        self.model, self.data = model, data
        self._known: dict[bytes, Residuals] = {}

    def residuals(self, p: Array) -> Residuals:
        """Residuals at parameters p."""
        key = p.tobytes()
        if key not in self._known:
            self._known[key] = self.model.residuals(p, self.data)
        return self._known[key]


def scan(cached: CachedResiduals, p: Array, covariance: Array, jacobian: Jacobian | None) -> Array:
    """Best parameters of a grid search over the effects' parameters, one after another.

    With the `jacobian` of a fit nearby, the base parameters are adapted at each point of the grid by the linear model.
    The point that is then expected to be best is checked by a simulation."""
    model = cached.model
    low, high = model.bounds()
    parameters = [q for own in model.parameters for q in own]
    first = model.size - len(parameters)

    best = total_log_likelihood(cached.residuals(p), covariance)
    for k, parameter in enumerate(parameters, first):
        if k in scatter_positions(model):
            continue
        choices = [to_scale(parameter, v) for v in parameter.choices]
        grid = choices or np.linspace(low[k], high[k], SCAN_VALUES)
        trials = [np.where(np.arange(model.size) == k, z, p) for z in grid]
        adapted: list[tuple[float, Array]] = []
        for trial in trials:
            residuals = cached.residuals(trial)
            total = total_log_likelihood(residuals, covariance)
            if total > best:
                best, p = total, trial
            if jacobian is not None:
                step, after = _base_step(model, trial, residuals, jacobian, covariance)
                adapted.append((total_log_likelihood(after, covariance), np.clip(trial - step, low, high)))
        expected, other = max(adapted, key=lambda pair: pair[0], default=(-np.inf, p))
        if expected > best and (total := total_log_likelihood(cached.residuals(other), covariance)) > best:
            best, p = total, other
    return p


def _base_step(
    model: Model, p: Array, residuals: Residuals, jacobian: Jacobian, covariance: Array
) -> tuple[Array, Residuals]:
    """(P,) step of the parameters of the base law, to subtract, and the residuals expected after it."""
    n = len(BASE_WIDTH)
    centre, prior_precision = prior(model)
    of_base = jacobian.only(slice(n))
    curvature, grad = normal_equations(residuals, of_base, covariance)
    grad += prior_precision[:n] * (p[:n] - centre[:n])
    step = np.zeros(model.size)
    step[:n] = np.linalg.solve(curvature + np.diag(prior_precision[:n]), grad).clip(
        -LARGEST_BASE_STEP, LARGEST_BASE_STEP
    )
    return step, Residuals(
        residuals.impacts - of_base.impacts @ step[:n], residuals.flights - of_base.flights @ step[:n]
    )
