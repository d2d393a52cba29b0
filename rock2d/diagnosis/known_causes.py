"""A known cause of known size in a fitted model: the parameters of the model with the cause."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from rock2d.arrays import Array
from rock2d.diagnosis.model import Model, is_factor, to_scale
from rock2d.effects import catalogue
from rock2d.effects.effect import Effect, Parameter
from rock2d.errors import InputError
from rock2d.files.checked_yaml import did_you_mean, shown
from rock2d.scene.world import World


def size_parameter(effect: Effect, world: World) -> Parameter:
    """The parameter that is the size of an effect: the first one, with its range at the scale of `world`. An effect
    that is a choice has no size, see `effects_of_size`."""
    return effect.parameters[0].at(world.mean_size_m, world.gravity_m_s2)


def effects_of_size(names: str) -> list[str]:
    """The effects in the list "a,b,...", or all effects with a size if it is empty. Raises InputError for an effect
    that is not in the catalogue or has no size."""
    known = {name: e for name, e in catalogue().items() if not e.parameters[0].choices}
    chosen = names.split(",") if names else list(known)
    for name in chosen:
        if name not in known:
            message = f"no effect with a size is called {shown(name)}{did_you_mean(name, known)}"
            raise InputError(message, code="unknown_name", name=name)
    return chosen


def values_of_size(effect: Effect, size: float, world: World, below: bool = False) -> dict[str, float]:
    """Parameter -> value of an effect of this size: the first parameter is `size` above its neutral value, or below it
    if only that is possible, or if `below` is set and possible. Compulsory choices take their first value; other
    parameters are left out and stay neutral."""
    first = size_parameter(effect, world)
    down = first.high <= first.neutral or (below and two_sided(first))
    values = {first.name: first.neutral + (-size if down else size)}
    return values | {q.name: q.choices[0] for q in effect.parameters[1:] if q.must_choose}


def two_sided(parameter: Parameter) -> bool:
    """Whether a parameter may be above and below its neutral value."""
    return parameter.low < parameter.neutral < parameter.high


def with_cause(model: Model, p: Array, effect: Effect, values: Mapping[str, float]) -> tuple[Model, Array, Array]:
    """A model with the effect, and its parameters (P,) without and with the cause.

    If the model already has the effect, the values add up; factors multiply. A scatter is not changed."""
    if effect.name not in model.positions:
        model = replace(model, effects=[*model.effects, effect])
        p = np.concatenate([p, model.start()[len(p) :]])
    moved = p.copy()
    for at, q in enumerate(model.parameters_of(effect.name), model.positions[effect.name].start):
        if q.name in values and not effect.scatter:
            moved[at] = to_scale(q, values[q.name]) + (0.0 if q.choices else p[at])
    return model, p, moved


def largest_size(parameter: Parameter) -> float:
    """The largest plausible size, see `values_of_size`."""
    return abs((parameter.high if parameter.high > parameter.neutral else parameter.low) - parameter.neutral)


def distance_from_neutral(parameter: Parameter, low: float, high: float) -> float:
    """Distance of the farther end of an interval from the neutral value; a factor below 1 counts as its inverse."""
    ends = [low, high]
    if is_factor(parameter):
        return max(max(v, 1.0 / v) for v in ends) - 1.0
    return max(abs(v - parameter.neutral) for v in ends)
