"""Derivatives of the residuals by finite differences, and the covariance of their measurement noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from rock2d.arrays import Array
from rock2d.diagnosis.data import Data, FilmData, Residuals
from rock2d.diagnosis.model import (
    BASE_WIDTH,
    LeverDerivatives,
    LeverResponse,
    Model,
    choice_positions,
    from_scale,
    scatter_positions,
)
from rock2d.effects.effect import Effect
from rock2d.engines.batch import run_world
from rock2d.kinematics.turned_ground import lifted, run_on_turned_ground
from rock2d.records.columns import BEFORE, I_TIME, N_STATE
from rock2d.scene.world import World

DIFFERENCE_STEP = 0.02  # step of finite differences, as a share of a parameter's scale
NOISE_DRAWS, NOISE_SEED = 20, 0  # draws of noise and soil that show what they do beyond first order; seed of them
# standard deviation of the soil at the start of a fit; at this value `Noise.beyond` has the size that was drawn
START_SCATTER = 0.05


class Noise(NamedTuple):
    """What noise does to the residuals of impacts.

    Attributes
    ----------
    covariance : (n, d, d) from the measured states before and after, to first order
    beyond : (n, d, d) columns by what noise and soil do beyond first order. Their standard deviation is fitted, because
        the draws depend on the soil's scatter, which is fitted later"""

    covariance: Array
    beyond: Array


@dataclass
class Jacobian:
    """Derivatives of the residuals.

    Attributes
    ----------
    impacts : (n, d, P) of impacts by parameters
    flights : (m, 3, degrees, P) of flights by parameters
    scatter : (n, d, k) of impacts by what scatters from impact to impact: the soil, effects that widen the scatter,
        and fitted noise. The last one is 0: its standard deviation belongs to `noise.beyond`
    later : (n, d, k) the part of `scatter` that comes from later strikes of an impact, which meet another place
    bend : (n, d, k) second order of the same, which adds a variance (bend σ²)² at a standard deviation σ; 0 for the
        soil, whose second order is part of `noise.beyond`
    noise : what noise does to the residuals of impacts"""

    impacts: Array
    flights: Array
    scatter: Array
    later: Array
    bend: Array
    noise: Noise

    def scattered_by(self, columns: Array) -> Jacobian:
        """The same derivatives with some of the columns of `scatter`, `later` and `bend`."""
        scatter, later, bend = (np.ascontiguousarray(s[..., columns]) for s in (self.scatter, self.later, self.bend))
        return replace(self, scatter=scatter, later=later, bend=bend)

    def beside(self, impacts: Array, flights: Array) -> Jacobian:
        """The derivatives with those by further parameters, (n, d, k) and (m, 3, degrees, k)."""
        impacts, flights = (
            np.concatenate(both, axis=-1) for both in ((self.impacts, impacts), (self.flights, flights))
        )
        return replace(self, impacts=impacts, flights=flights)

    def only(self, parameters: Array | slice) -> Jacobian:
        """The derivatives by some of the parameters. The arrays are contiguous, because sums in a worker would
        otherwise differ in the last digits: the memory layout would change on the way."""
        impacts, flights = (np.ascontiguousarray(own[..., parameters]) for own in (self.impacts, self.flights))
        return replace(self, impacts=impacts, flights=flights)


class Point(NamedTuple):
    """Parameters (P,) and the residuals at them."""

    p: Array
    residuals: Residuals


def jacobian_by_differences(
    model: Model,
    point: Point,
    data: Data,
    soil: Array,
    noise: Noise | None = None,
    later: Array | None = None,
    known: Jacobian | None = None,
) -> Jacobian:
    """Derivatives at a point by finite differences.

    Parameters
    ----------
    soil : (k,) scatter at which the noise and the derivatives by scatter are computed
    noise : `Jacobian.noise`, if known
    later : `Jacobian.later` of a fit nearby, if it is taken over
    known : derivatives by the first parameters there, if known"""
    p, at = point
    (n, d), size = at.impacts.shape, model.size
    by_impacts, by_flights = np.zeros((n, d, size)), np.zeros((*at.flights.shape, size))
    _, high = model.bounds()
    first = 0
    if known is not None:
        first = known.impacts.shape[-1]
        by_impacts[..., :first], by_flights[..., :first] = known.impacts, known.flights
    fixed = {*scatter_positions(model), *choice_positions(model)}
    steps = np.where(p + DIFFERENCE_STEP <= high, DIFFERENCE_STEP, -DIFFERENCE_STEP)
    for k in sorted(set(range(first, model.named_size)) - fixed):
        stepped = model.residuals(p + steps[k] * (np.arange(size) == k), data)
        by_impacts[..., k] = (stepped.impacts - at.impacts) / steps[k]
        by_flights[..., k] = (stepped.flights - at.flights) / steps[k]
    by_law, named = by_impacts[..., : len(BASE_WIDTH)], model.named_size
    if model.responses and first < size:
        by_levers = LeverDerivatives(model, p, data, at, by_law)
        parts = [by_levers.by_coefficients(response) for response in model.responses]
        by_impacts[..., named:] = np.concatenate([part.impacts for part in parts], axis=-1) * model.widths
        by_flights[..., named:] = np.concatenate([part.flights for part in parts], axis=-1) * model.widths
    columns, bends = [by_law], [np.zeros_like(by_law)]
    further = np.concatenate([data.extra_scatter(), np.zeros((n, d, 1))], axis=-1)
    for effect, sigma in zip(model.scatter_effects, soil[len(BASE_WIDTH) :]):  # noqa: B905 (further scatter follows)
        slope, bend = by_scatter(model, p, data, at, effect, sigma)
        columns.append(slope)
        bends.append(bend)
    scatter = np.nan_to_num(np.concatenate([*columns, further], axis=-1))
    bend = np.nan_to_num(np.concatenate([*bends, np.zeros_like(further)], axis=-1))
    of_later, law = np.zeros_like(scatter), slice(len(BASE_WIDTH))
    of_later[..., law] = by_later_strikes(model, p, data, steps[law]) if later is None else later[..., law]
    if noise is None:
        none = Noise(data.outcome_noise(), np.zeros((n, d, d)))
        noise = _noise(model, p, data, at, soil, np.nan_to_num(by_law)) if n else none
    return Jacobian(np.nan_to_num(by_impacts), by_flights, scatter, of_later, bend, noise)


def by_scatter(model: Model, p: Array, data: Data, at: Residuals, effect: Effect, sigma: float) -> tuple[Array, Array]:
    """Columns (n, d, 1) of `Jacobian.scatter` and `Jacobian.bend` for an effect at the standard deviation `sigma`.

    The effect is set to √3 σ at every impact, and to -√3 σ: with 0, the nodes of a Gauss-Hermite quadrature.
    An answer a x + b x² has the variance a² σ² + 2 b² σ⁴. The shift of the mean, b σ², is left out."""
    i, step, sides = list(model.effects).index(effect), np.sqrt(3.0) * max(sigma, DIFFERENCE_STEP), []
    for amount in (step, -step):
        amounts = [list(v) for v in model.values(p)]
        amounts[i] = [from_scale(model.parameters[i][0], amount)]
        sides.append(model.residuals(p, data, amounts=amounts).impacts)
    ahead, behind = sides
    bend = np.sqrt(2.0) * (ahead + behind - 2.0 * at.impacts) / (2.0 * step**2)
    return ((ahead - behind) / (2.0 * step))[..., None], bend[..., None]


def by_later_strikes(model: Model, p: Array, data: Data, steps: Array) -> Array:
    """(n, d, 5) derivatives at p of the residuals of impacts by the soil of all strikes but the first, by differences
    with `steps` (5,) of the parameters of the law.

    The soil varies from place to place, and later corners, or the same one again, meet another place. So the first
    strike of an impact has one draw of the soil, and all later ones together have another. A strike lasts from the
    first contact until nothing touches: corners that press at the same time are one strike. 0 in an impact table: each
    of its rows is one strike."""
    size, count = len(BASE_WIDTH), len(data.impact_release)
    if not (isinstance(data, FilmData) and count):
        return np.zeros((count, data.outcome_noise().shape[-1], size))
    world, shift = model.acting(p, data.impact_order)
    known = data.observed(world)
    starts: Array = known.starts + shift
    instants_s = known.instants_s
    possible = np.isfinite(starts).all(axis=1)
    starts, instants_s = np.where(possible[:, None], starts, 0.0), np.where(possible[:, None], instants_s, 0.0)
    second_s, left = _second_strikes(world, data, starts, instants_s)
    own = np.flatnonzero(possible & np.isfinite(second_s))
    changes = np.zeros((*instants_s.shape, 3, size))
    if len(own):
        worlds = [world] + [
            model.acting(p + step, data.impact_order)[0] for step in steps[:, None] * np.eye(size, len(p))
        ]
        rows = [np.broadcast_to(each.contact, (count, *each.contact.shape[1:]))[own] for each in worlds]
        level = replace(world, contact=np.concatenate(rows), slope_rad=np.zeros(1))
        block, since_s = (np.concatenate([part] * len(worlds)) for part in (
            data.impact_block[own], np.maximum(instants_s - second_s[:, None], 0.0)[own],
        ))  # fmt: skip
        start = lifted(level, block, np.tile(left[own], (len(worlds), 1)))
        poses = run_world(
            level, start, block, time_limit_s=since_s[:, -1] + 1e-9, times_s=since_s, step_fraction=data.step_fraction
        ).samples
        same, *changed = np.split(poses, len(worlds))
        for k, (pose, step) in enumerate(zip(changed, steps, strict=True)):
            changes[own, ..., k] = (pose - same) / step
    return np.nan_to_num(np.stack([data.outcomes(world, changes[..., k]) for k in range(size)], axis=-1))


def _second_strikes(world: World, data: FilmData, starts: Array, instants_s: Array) -> tuple[Array, Array]:
    """True times after `starts` of the second strikes (n,), NaN where there is none, and the states then (n, 6)."""
    block, limits_s = data.impact_block, instants_s[:, -1]
    if world.slope_rad.any():
        steps = data.step_fraction
        struck = run_on_turned_ground(world, block, starts, limits_s, instants_s, steps).impacts_s
        second_s = np.sort(struck, axis=1)[:, 1]  # NaN last
        until_s = np.where(np.isfinite(second_s), second_s, 0.0)
        return second_s, run_on_turned_ground(world, block, starts, until_s, instants_s[:, :0], steps).ends
    second = run_world(
        world, starts, block, time_limit_s=limits_s, impact_limit=2, impact_room=2, step_fraction=data.step_fraction
    ).impacts[:, 1]
    return second[:, I_TIME], second[:, BEFORE]


def _noise(model: Model, p: Array, data: Data, at: Residuals, scatter: Array, by_law: Array) -> Noise:
    """The noise of the residuals, from that of the measured states before and after, and what both and the soil's
    scatter (5,) do beyond first order; `by_law` (n, d, 5): first order of the soil.

    First order is not enough where a small change before an impact changes it, for example which corner lands first.
    Draws of noise and soil show how far such impacts are spread. The draws are the same at each call. So the covariance
    hardly changes with p, and fits with different effects can be compared."""
    before = data.state_noise(model.world(p, data.impact_order))
    sigma = np.sqrt(np.maximum(np.median(np.diagonal(before, axis1=1, axis2=2), axis=0), 1e-18))
    slope = []
    for k in range(N_STATE):
        shift = sigma[k] * (np.arange(N_STATE) == k)
        slope.append(model.residuals(p, data, shift).minus(model.residuals(p, data, -shift)).impacts / (2 * sigma[k]))
    by_state = np.nan_to_num(np.stack(slope, axis=-1))
    rng, root = np.random.default_rng(np.random.SeedSequence(NOISE_SEED)), square_roots(before)
    covariance = by_state @ before @ by_state.transpose(0, 2, 1) + data.outcome_noise()
    further = np.zeros_like(covariance)
    for _ in range(NOISE_DRAWS):
        shift, soil = times_normal(root, rng), scatter[: len(BASE_WIDTH)] * rng.normal(size=by_law[:, 0].shape)
        first_order = np.einsum("ndk,nk->nd", by_state, shift) + np.einsum("ndk,nk->nd", by_law, soil)
        beyond = np.nan_to_num(drawn_impacts(model, p, data, soil, shift) - at.impacts - first_order)
        further += beyond[:, :, None] * beyond[:, None, :] / NOISE_DRAWS
    return Noise(covariance, square_roots(further) / START_SCATTER)


def drawn_impacts(
    model: Model, p: Array, data: Data, soil: Array, shift: Array, amounts: Sequence[Sequence[Any]] | None = None
) -> Array:
    """(n, d) residuals of impacts with changes (n, 5) of the soil, as the scatter, and (n, 6) of the states before.

    `amounts`: see `Model.world`"""
    drawn = LeverResponse(1, law=soil[..., None], shift=shift[..., None])
    model = replace(model, responses=[*model.responses, drawn], widths=np.append(model.widths, 1.0))
    return model.residuals(np.append(p, 1.0), data, amounts=amounts).impacts


def square_roots(covariance: Array) -> Array:
    """(n, d, d) symmetric square roots of covariances, which may be singular."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray((vectors * np.sqrt(np.maximum(values, 0.0))[:, None]) @ vectors.transpose(0, 2, 1))


def times_normal(columns: Array, rng: np.random.Generator) -> Array:
    """(n, d) columns (n, d, k), each times a normal number."""
    return np.einsum("ndk,nk->nd", columns, rng.normal(size=columns[:, 0].shape))


def residual_covariance(jacobian: Jacobian, scatter: Array) -> Array:
    """(n, d, d) covariances at standard deviations `scatter` (k,) of what varies from impact to impact."""
    wide = ScatterColumns.of(jacobian).scaled(scatter)
    return jacobian.noise.covariance + wide @ wide.transpose(0, 2, 1)


class ScatterColumns(NamedTuple):
    """What varies from impact to impact, as independent columns.

    Attributes
    ----------
    columns : (n, d, c) of the first strike, of later ones, of second order, and of `Noise.beyond`; those of later
        strikes and of second order where they are not 0
    owner : (c,) standard deviation that each belongs to
    order : (c,) power of the standard deviation in it
    share : (c, k) order of each column in the standard deviation that it belongs to, else 0"""

    columns: Array
    owner: Array
    order: Array
    share: Array

    @classmethod
    def of(cls, jacobian: Jacobian) -> ScatterColumns:
        """The columns of these derivatives."""
        k, beyond = jacobian.scatter.shape[-1], jacobian.noise.beyond
        again, bent = (np.flatnonzero(own.any(axis=(0, 1))) for own in (jacobian.later, jacobian.bend))
        parts = [jacobian.scatter - jacobian.later, jacobian.later[..., again], jacobian.bend[..., bent], beyond]
        owner = np.concatenate([np.arange(k), again, bent, np.full(beyond.shape[-1], k - 1)])
        order = np.repeat([1.0, 2.0, 1.0], [k + len(again), len(bent), beyond.shape[-1]])
        return cls(np.concatenate(parts, axis=-1), owner, order, np.eye(k)[owner] * order[:, None])

    def scaled(self, scatter: Array) -> Array:
        """(n, d, c) the columns at standard deviations `scatter` (k,)."""
        return np.asarray(self.columns * scatter[self.owner] ** self.order)
