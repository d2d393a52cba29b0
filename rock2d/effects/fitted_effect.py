"""A fitted effect, from which its remedy is derived."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from rock2d.arrays import Array
from rock2d.effects.effect import Effect, Parameter
from rock2d.scene.world import World
from rock2d.wording import number, plain, point

TRACK_AGAIN = "Track the film again and diagnose again."


@dataclass(frozen=True)
class FittedEffect:
    """An effect with its fitted parameters, and the set-up that it was fitted to.

    Attributes
    ----------
    values, half : parameter name -> value, and half the width of its 95 % interval
    law : the law's parameters fitted together with the effect, names as in diagnosis.json
    setup : the world as stated
    fps : stated frame rate
    impacts_only : whether the record is a table of impacts instead of a film
    by_block : parameter name -> block -> value as in diagnosis.json, for parameters with a value for each block"""

    effect: Effect
    values: Mapping[str, float]
    half: Mapping[str, float]
    law: Mapping[str, float]
    setup: World
    fps: float
    impacts_only: bool
    by_block: Mapping[str, Mapping[str, Any]]

    @classmethod
    def of(
        cls,
        effect: Effect,
        parameters: Mapping[str, Any],
        law: Mapping[str, float],
        setup: World,
        fps: float,
        impacts_only: bool,
    ) -> FittedEffect:
        """From the `parameters` of an effect in diagnosis.json."""
        values = {p.name: p.neutral for p in effect.parameters if p.may_be_missing}
        values |= {key: float(entry["value"]) for key, entry in parameters.items()}
        half = {key: 0.5 * float(entry["ci95"][1] - entry["ci95"][0]) for key, entry in parameters.items()}
        by_block = {key: entry["by_block"] for key, entry in parameters.items() if "by_block" in entry}
        return cls(effect, values, half, law, setup, fps, impacts_only, by_block)

    def world(self, changes: Mapping[str, float] | None = None) -> World:
        """The set-up with the effect, at the fitted values or with some of them changed."""
        values = {**self.values, **(changes or {})}
        return self.effect.apply(self.setup, [values[p.name] for p in self.effect.parameters])

    def number(self, name: str, factor: float = 1.0) -> str:
        """A parameter times a factor, as text."""
        return number(factor * self.values[name], factor * self.half[name])

    def propagated(self, of_world: Callable[[World], Array]) -> tuple[Array, Array]:
        """Value of a function of the world, and half the width of its 95 % interval (for independent parameters)."""
        value = of_world(self.world())
        moved = [of_world(self.world({name: self.values[name] + half})) for name, half in self.half.items()]
        return value, np.sqrt(np.sum([(other - value) ** 2 for other in moved], axis=0))

    def ended(self) -> list[tuple[str, Parameter]]:
        """(block, "" for all; parameter with its range at the scale of the set-up) where the fit ended at an end of
        the plausible range."""
        found = []
        for parameter in self.effect.parameters:
            own = {"": (self.setup.mean_size_m, self.values[parameter.name])}
            if parameter.name in self.by_block:
                each = self.by_block[parameter.name]
                own = {name: (self.setup.blocks[name].size_m, float(entry["value"])) for name, entry in each.items()}
            for name, (size_m, value) in own.items():
                scaled = parameter.at(size_m, self.setup.gravity_m_s2)
                found += [(name, scaled)] if scaled.ended_at(value) else []
        return found

    def origin(self) -> str:
        """Sentence on the true position of the default origin; the point that stays is one of the fitted parameters."""
        at, half = self.propagated(lambda world: np.asarray(world.view.true(np.zeros(3))[:2]))
        x, y = self.world().view.fixed_m
        return (
            f"Set `origin_m: {point(at, half)}` if it was [0, 0]: the record changes about the point "
            f"({plain(x)}, {plain(y)}) m, and so does any other `origin_m`."
        )

    def by_hand(self, film: str, table: str) -> str:
        """How to correct the record without tracking again: text for a film, or for a table of impacts."""
        return f"\nWithout a set-up file: {table if self.impacts_only else film}."
