"""A model to be fitted: the base law with effects and learnt changes, and parameters on dimensionless scales of similar
size."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from rock2d.arrays import Array
from rock2d.diagnosis.data import Data, Residuals
from rock2d.effects.effect import FLIGHT, Effect, Parameter
from rock2d.laws.contact import K_L, K_R, K_T, K_UL, MU
from rock2d.records.columns import N_STATE
from rock2d.scene.world import World

BASE_NAMES = ("k_l_N_m", "k_ul_N_m", "k_t_N_m", "friction_angle_deg", "k_r_Nm_rad")
# positions of the base parameters: k_l, k_ul / k_l, k_t, tan phi, k_r
BASE_K_L, BASE_RATIO, BASE_K_T, BASE_MU, BASE_K_R = range(5)
# logarithmic standard deviation of the prior of the base parameters
BASE_WIDTH = np.array([2.0, 0.7, 2.0, 0.7, 2.0])
# logarithm of k_l / start; stiffer ground takes longer to simulate and gives the same motion
LARGEST_LOG_K_L = 4.5
STIFFNESS_PARAMETERS = [BASE_K_L, BASE_K_T]  # k_ul follows k_l
STIFFNESS_HEADROOM = 2.0  # logarithm of the factor by which they may grow in a fit with effects
SMALLEST_STIFFNESS_RATIO = 1.02  # least ratio of unloading to loading stiffness
LARGEST_COEFFICIENT = 10.0  # of a learnt change, in units of its prior's standard deviation
SLOPE_STEP_RAD = 0.003  # for differences
STATE_STEP = 0.003  # for differences, in units of `state_units`


@dataclass
class LeverResponse:
    """Change of the data with the coefficients of a lever on a basis. There is a coefficient for each component of the
    lever and function of the basis; the functions of a component are adjacent.

    Attributes
    ----------
    size : c, number of coefficients
    law : (n, 5, c) change of the logarithms of the law's parameters, as in `Model`; None if there is no change
    slope : (n, c) change of the slope of the ground in rad, or None
    shift : (n, 6, c) change of the states before the impacts, or None
    impacts : (n, d, c) direct change of the residuals of impacts, or None
    flights : (m, 3, degrees, c) change of the residuals of flights, or None"""

    size: int
    law: Array | None = None
    slope: Array | None = None
    shift: Array | None = None
    impacts: Array | None = None
    flights: Array | None = None


@dataclass(frozen=True)
class Model:
    """Base law, effects and learnt changes; `world(p)` is the world at parameters p, without the learnt changes.

    p: first the five of the base, then those of the effects, then the coefficients of the learnt changes. They are
    dimensionless: logarithms relative to `base`, effect parameters in units of their plausible range, coefficients in
    units of `widths` (c,).
    `known_p`: parameters of the fit to which effects are added, if any; its stiffnesses limit those of the model.
    `flown`: blocks with parameters of their own for effects in flight, on the scale of their size; if empty, all blocks
    share the parameters."""

    setup: World
    base: Array
    effects: Sequence[Effect] = ()
    known_p: Array | None = None
    flown: Sequence[str] = field(default=(), kw_only=True)
    responses: Sequence[LeverResponse] = field(default=(), kw_only=True)
    widths: Array = field(default_factory=lambda: np.empty(0), kw_only=True)

    @cached_property
    def parameters(self) -> list[list[Parameter]]:
        """Parameters of each effect, with their ranges at the scale of this set-up."""
        mean, own = [self.setup.mean_size_m], [self.setup.blocks[name].size_m for name in self.flown]
        return [
            [
                p.at(size, self.setup.gravity_m_s2)
                for size in (own if self.has_own_parameters(e) else mean)
                for p in e.parameters
            ]
            for e in self.effects
        ]

    def has_own_parameters(self, effect: Effect) -> bool:
        """Whether each block has its own parameters of an effect."""
        return bool(self.flown) and effect.origin == FLIGHT

    @cached_property
    def positions(self) -> dict[str, slice]:
        """Effect -> positions of its parameters in p."""
        ends = np.cumsum([len(BASE_WIDTH), *map(len, self.parameters)]).tolist()
        return {e.name: slice(*own) for e, own in zip(self.effects, pairwise(ends), strict=True)}

    def parameters_of(self, name: str) -> list[Parameter]:
        """Parameters of one effect, as in `parameters`."""
        return self.parameters[list(self.positions).index(name)]

    def applied(self, effect: Effect, world: World, values: Sequence[float]) -> World:
        """The world with an effect whose parameters have these `values`."""
        if not self.has_own_parameters(effect):
            return effect.apply(world, values)
        each = np.reshape(values, (len(self.flown), -1))
        without = effect.apply(world, [p.neutral for p in effect.parameters])
        return effect.on_blocks(without, dict(zip(self.flown, each, strict=True)))

    @property
    def named_size(self) -> int:
        """Number of the parameters of the base law and the effects."""
        return len(BASE_WIDTH) + sum(map(len, self.parameters))

    @property
    def size(self) -> int:
        """Number of all parameters."""
        return self.named_size + len(self.widths)

    @property
    def scatter_effects(self) -> list[Effect]:
        """Effects that only widen the scatter."""
        return [e for e in self.effects if e.scatter]

    def start(self) -> Array:
        """Parameters of `base`, with neutral effects and no learnt change."""
        neutral = [to_scale(p, p.neutral) for own in self.parameters for p in own]
        return np.concatenate([np.zeros(len(BASE_WIDTH)), neutral, np.zeros(len(self.widths))])

    def bounds(self) -> tuple[Array, Array]:
        """(P,) lowest and highest parameters."""
        low = [to_scale(p, p.low) for own in self.parameters for p in own]
        high = [to_scale(p, p.high) for own in self.parameters for p in own]
        most = 3 * BASE_WIDTH
        most[BASE_K_L] = LARGEST_LOG_K_L
        if self.known_p is not None:
            # a fit with a useless effect could drift to a rigid ground, which takes very long to simulate
            known = np.maximum(self.known_p[STIFFNESS_PARAMETERS], 0.0)
            most[STIFFNESS_PARAMETERS] = np.minimum(most[STIFFNESS_PARAMETERS], known + STIFFNESS_HEADROOM)
        learnt = np.full(len(self.widths), LARGEST_COEFFICIENT)
        return np.concatenate([-3 * BASE_WIDTH, low, -learnt]), np.concatenate([most, high, learnt])

    def law(self, p: Array) -> Array:
        """(5,) k_l, k_ul, k_t, tan phi, k_r at p."""
        k_l, ratio, k_t, mu, k_r = self.base * np.exp(p[: len(BASE_WIDTH)])
        return np.array([k_l, k_l * max(ratio, SMALLEST_STIFFNESS_RATIO), k_t, mu, k_r])

    def values(self, p: Array) -> list[list[float]]:
        """Values of each effect's parameters at p."""
        return [
            [from_scale(q, z) for q, z in zip(own, p[at], strict=True)]
            for own, at in zip(self.parameters, self.positions.values(), strict=True)
        ]

    def world(self, p: Array, order: Array, amounts: Sequence[Sequence[Any]] | None = None) -> World:
        """The world at p for releases with these positions `order` in their series; `amounts` replace the values of the
        effects."""
        rows = self.setup.contact.copy()
        rows[..., [K_L, K_UL, K_T, MU, K_R]] = self.law(p)
        world = replace(self.setup, contact=rows, order=order)
        for effect, values in zip(self.effects, amounts or self.values(p), strict=True):
            if not effect.scatter or amounts is not None:
                world = self.applied(effect, world, values)
        return world

    def residuals(
        self, p: Array, data: Data, shift: Array | float = 0.0, amounts: Sequence[Sequence[Any]] | None = None
    ) -> Residuals:
        """Residuals at p; `shift` (6,) or (n, 6) is added to the states before the impacts; `amounts`: see `world`."""
        world, shift = self.acting(p, data.impact_order, shift, amounts)
        coefficients, residuals = self.coefficients(p), data.residuals(world, shift)
        for response, c in zip(self.responses, coefficients, strict=True):
            if response.impacts is not None:
                residuals.impacts = residuals.impacts + response.impacts @ c
            if response.flights is not None:
                residuals.flights = residuals.flights + response.flights @ c
        return residuals

    def acting(
        self, p: Array, order: Array, shift: Array | float = 0.0, amounts: Sequence[Sequence[Any]] | None = None
    ) -> tuple[World, Array | float]:
        """World of the impacts at p, and shift of the states before, with the learnt changes; see `residuals`."""
        world = self.world(p, order, amounts)
        for response, c in zip(self.responses, self.coefficients(p), strict=True):
            if response.law is not None:
                world = with_changed_law(world, response.law @ c)
            if response.slope is not None:
                world = replace(world, slope_rad=world.slope_rad + response.slope @ c)
            if response.shift is not None:
                shift = shift + response.shift @ c
        return world, shift

    def coefficients(self, p: Array) -> list[Array]:
        """Coefficients of each learnt change."""
        ends = np.cumsum([response.size for response in self.responses])[:-1]
        return np.split(p[self.named_size :] * self.widths, ends) if self.responses else []


class LeverDerivatives:
    """Derivatives of the residuals of a model at parameters p by the levers of every impact.

    `at`: residuals at p; `by_law` (n, d, 5): derivatives of impacts by the parameters of the base law."""

    def __init__(self, model: Model, p: Array, data: Data, at: Residuals, by_law: Array) -> None:
        self.model, self.p, self.data, self.at, self.by_law = model, p, data, at, by_law

    @cached_property
    def by_slope(self) -> Array:
        """(n, d) derivatives of the residuals of impacts by the slope of the ground."""
        setup = self.model.setup
        tilted = replace(self.model, setup=replace(setup, slope_rad=setup.slope_rad + SLOPE_STEP_RAD))
        return tilted.residuals(self.p, self.data).minus(self.at).impacts / SLOPE_STEP_RAD

    @cached_property
    def by_state(self) -> Array:
        """(n, d, 6) derivatives of the residuals of impacts by the states before them."""
        setup, columns = self.model.setup, []
        for k, unit in enumerate(STATE_STEP * state_units(setup)):
            shift = unit * (np.arange(N_STATE) == k)
            columns.append(self.model.residuals(self.p, self.data, shift).minus(self.at).impacts / unit)
        return np.stack(columns, axis=-1)

    def by_coefficients(self, response: LeverResponse) -> Residuals:
        """Derivatives of all residuals by the coefficients of a change. The chain rule saves simulations: many
        coefficients change few components of a lever."""
        impacts, flights = (np.zeros((*own.shape, response.size)) for own in (self.at.impacts, self.at.flights))
        if response.law is not None:
            impacts += self.by_law @ response.law
        if response.slope is not None:
            impacts += self.by_slope[..., None] * response.slope[:, None]
        if response.shift is not None:
            impacts += self.by_state @ response.shift
        if response.impacts is not None:
            impacts += response.impacts
        return Residuals(impacts, flights if response.flights is None else response.flights)


def state_units(world: World) -> Array:
    """(6,) natural units of a state: half the mean size of the blocks and √(gravity × half the size)."""
    half = world.mean_size_m / 2.0
    pace = np.sqrt(world.gravity_m_s2 * half)
    return np.array([half, half, 1.0, pace, pace, pace / half])


def with_changed_law(world: World, change: Array) -> World:
    """The world with a changed soil for each of n releases; `change` (n, 5): logarithms, as in the parameters of
    `Model`."""
    n = len(change)
    rows = np.repeat(world.contact, n, axis=0) if len(world.contact) == 1 else world.contact.copy()
    k_l, ratio, k_t, mu, k_r = change.T
    rows[..., [K_L, K_UL, K_T, MU, K_R]] *= np.exp(np.column_stack([k_l, k_l + ratio, k_t, mu, k_r]))[:, None]
    rows[..., K_UL] = np.maximum(rows[..., K_UL], SMALLEST_STIFFNESS_RATIO * rows[..., K_L])
    return replace(world, contact=rows)


def is_factor(p: Parameter) -> bool:
    """Whether a parameter is a factor: it then has a logarithmic scale."""
    return p.neutral == 1.0 and p.low > 0.0


def to_scale(p: Parameter, value: float) -> float:
    """Parameter value -> the optimiser's scale: logarithm of a factor, else (value - neutral) / half the range."""
    if is_factor(p):
        return float(np.log(value))
    return (value - p.neutral) / (0.5 * (p.high - p.low))


def from_scale(p: Parameter, z: float) -> float:
    """The inverse of `to_scale`."""
    if is_factor(p):
        return float(np.exp(z))
    return p.neutral + z * 0.5 * (p.high - p.low)


def choice_positions(model: Model) -> list[int]:
    """Positions in p of the parameters with a list of choices."""
    parameters = [q for own in model.parameters for q in own]
    return [len(BASE_WIDTH) + i for i, q in enumerate(parameters) if q.choices]


def scatter_positions(model: Model) -> list[int]:
    """Positions in p of the parameters that are standard deviations from impact to impact."""
    return [model.positions[e.name].start for e in model.scatter_effects]
