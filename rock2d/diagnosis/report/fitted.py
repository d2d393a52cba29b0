"""A fitted effect, as instructions about it need it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rock2d.diagnosis.report import text
from rock2d.effects.effect import Effect
from rock2d.files.experiment import Experiment
from rock2d.kinematics.setup_world import setup_world
from rock2d.scene.world import World

Array = np.ndarray


@dataclass(frozen=True)
class Fitted:
    """An effect with its fitted parameters, and the experiment that it was fitted to.

    Attributes
    ----------
    values, half : parameter name -> value, and half the width of its 95 % interval
    law : the law's parameters fitted together with the effect, names as in diagnosis.json
    each : parameter name -> block -> its own value as in diagnosis.json, where each block has one
    """

    effect: Effect
    values: Mapping[str, float]
    half: Mapping[str, float]
    law: Mapping[str, float]
    experiment: Experiment
    each: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    @classmethod
    def of(
        cls, effect: Effect, parameters: Mapping[str, Any], law: Mapping[str, float], experiment: Experiment
    ) -> Fitted:
        """From the `parameters` of an effect as diagnosis.json has them."""
        values = {p.name: p.neutral for p in effect.parameters if p.implied}
        values |= {key: float(entry["value"]) for key, entry in parameters.items()}
        half = {key: 0.5 * float(entry["ci95"][1] - entry["ci95"][0]) for key, entry in parameters.items()}
        each = {key: entry["by_block"] for key, entry in parameters.items() if "by_block" in entry}
        return cls(effect, values, half, law, experiment, each)

    def world(self, changes: Mapping[str, float] | None = None) -> World:
        """The world of the experiment with the effect, at the fitted values or with some of them changed."""
        values = {**self.values, **(changes or {})}
        return self.effect.apply(
            setup_world(self.experiment), [values[p.name] for p in self.effect.parameters]
        )

    def number(self, name: str, factor: float = 1.0) -> str:
        """A parameter times a factor, as text."""
        return text.number(factor * self.values[name], factor * self.half[name])

    def propagated(self, of_world: Callable[[World], Array]) -> tuple[Array, Array]:
        """What a function makes of the world, and half the width of its 95 % interval (parameters independent)."""
        value = of_world(self.world())
        moved = [of_world(self.world({name: self.values[name] + half})) for name, half in self.half.items()]
        return value, np.sqrt(np.sum([(other - value) ** 2 for other in moved], axis=0))

    @property
    def mass_kg(self) -> float:
        """Mean mass of the blocks."""
        return float(np.mean([block.mass_kg for block in self.experiment.blocks.values()]))

    @property
    def size_m(self) -> float:
        """Mean size of the blocks."""
        return float(np.mean([block.size_m for block in self.experiment.blocks.values()]))


def plain(value: float, half: float | None = None) -> str:
    """A number for a file: its digits as the uncertainty justifies, without signs that YAML does not know."""
    return text.number(value, half).replace("−", "-").replace("\N{NO-BREAK SPACE}", "").replace(" ", "")


def point(values: Array, half: Array) -> str:
    """A point for a file, "[x, y]"."""
    return f"[{', '.join(plain(v, h or None) for v, h in zip(values, half, strict=True))}]"
