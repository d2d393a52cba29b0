"""Effects of the catalogue and their parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import compress
from typing import Any

import numpy as np

from rock2d.registry import registered
from rock2d.scene.world import World

EDGE_DISTANCE = 0.01  # share of the plausible range; a parameter nearer to an end is at the end
LABORATORY_M = 0.02  # block size for which plausible ranges are stated
STANDARD_GRAVITY_M_S2 = 9.80665
CAMERA, FLIGHT, BLOCK, GROUND, IMPACT_LAW = ORIGINS = ("camera", "flight", "block", "ground", "impact law")


@dataclass(frozen=True)
class Parameter:
    """A parameter of an effect. `neutral`: value without the effect; `low`, `high`: plausible range.

    `choices`: possible values of a parameter that is not continuous, with the names `choice_names`. `length`, `time`:
    exponents of its unit; the range (and a neutral value other than 0) is stated for a laboratory and scales with the
    set-up, see `at`. `optional`: it only refines the effect; files may omit it, as those of earlier versions do."""

    name: str
    unit: str
    neutral: float
    low: float
    high: float
    meaning: str
    choices: tuple[float, ...] = ()
    choice_names: tuple[str, ...] = ()
    length: int = 0
    time: int = 0
    optional: bool = False

    @property
    def has_neutral_choice(self) -> bool:
        """Whether it is a choice, and one of the choices is neutral."""
        return self.neutral in self.choices

    @property
    def may_be_missing(self) -> bool:
        """Whether a file may omit it; it is then neutral."""
        return self.optional or self.has_neutral_choice

    @property
    def must_choose(self) -> bool:
        """Whether it is a choice without a neutral one: then no small step leads from no effect to the effect."""
        return bool(self.choices) and not self.has_neutral_choice

    def choice_name(self, value: float) -> str | None:
        """Name of a choice; None for a quantity."""
        return dict(zip(self.choices, self.choice_names, strict=False)).get(value)

    def ended_at(self, value: float) -> bool:
        """Whether a fitted value lies at an end of the plausible range: the fit stopped there, and measured nothing."""
        room = min(value - self.low, self.high - value)
        return not self.choices and value != self.neutral and room < EDGE_DISTANCE * (self.high - self.low)

    def at(self, size_m: float, gravity_m_s2: float) -> Parameter:
        """The parameter with its range for blocks of the mean size `size_m`: lengths scale with the size L, times with
        √(L / g)."""
        if not (self.length or self.time):
            return self
        size = size_m / LABORATORY_M
        factor = size**self.length * np.sqrt(size * STANDARD_GRAVITY_M_S2 / max(gravity_m_s2, 1e-3)) ** self.time
        return replace(self, neutral=self.neutral * factor, low=self.low * factor, high=self.high * factor)


@dataclass(frozen=True, repr=False)
class Effect:
    """A physical process or a recording error that the paper's model does not contain.

    Attributes
    ----------
    name : as in diagnosis.json
    summary : what is missing from the model, one line
    source : source of the law
    phase : where it changes the motion: "flight", "impact" or "all"
    origin : one of `ORIGINS`
    parameters : name, unit, neutral value and plausible range of each
    apply : (world, values in the order of `parameters`) -> the world with the effect
    remedy : (`rock2d.effects.fitted_effect.FittedEffect`) -> advice: what to correct, with sign and number, to measure,
        or to add to the model. Keys of files stand in backticks
    scatter : the (only) parameter is the standard deviation of a quantity that varies from impact to impact
        with mean zero; `apply` takes one value of that quantity
    grows : it grows from release to release of a series
    columns : names of the columns of a contact row, or of a block's `air`, that its law reads
    normal, friction, tangential, flight, recoil, departure : compiled laws, see `rock2d.effects.forces`
    damping : (columns) -> largest derivative of its forces by the speed of a contact in N s/m, arrays of any shape"""

    name: str
    summary: str
    source: str
    phase: str
    origin: str
    parameters: Sequence[Parameter]
    apply: Callable[[World, Sequence[float]], World]
    remedy: Callable[[Any], str] | None = None
    scatter: bool = False
    grows: bool = False
    columns: Sequence[str] = ()
    normal: Any = None
    friction: Any = None
    tangential: Any = None
    flight: Any = None
    recoil: Any = None
    departure: Any = None
    damping: Callable[..., Any] | None = None

    def __post_init__(self) -> None:
        if self.origin not in ORIGINS:
            raise ValueError(f"effect {self.name}: origin is one of {', '.join(ORIGINS)}; found {self.origin!r}")

    def __repr__(self) -> str:
        return f"<Effect {self.name}: {self.summary}>"

    @property
    def camera(self) -> bool:
        """Whether it changes only the record, not the motion."""
        return self.origin == CAMERA

    def without_refinement(self) -> Effect:
        """The effect with its optional parameters neutral; itself if it has none."""
        kept = [not q.optional for q in self.parameters]
        if all(kept):
            return self

        def apply(world: World, values: Sequence[float]) -> World:
            given = iter(values)
            return self.apply(
                world, [next(given) if own else q.neutral for q, own in zip(self.parameters, kept, strict=True)]
            )

        return replace(self, parameters=list(compress(self.parameters, kept)), apply=apply)

    def on_blocks(self, world: World, values: Mapping[str, Sequence[float]]) -> World:
        """The world with the effect on some blocks; `values`: block -> values of the parameters. Only for an effect
        that changes only blocks."""
        changed = {name: self.apply(world, parameters).blocks[name] for name, parameters in values.items()}
        return replace(world, blocks={**world.blocks, **changed})

    def __reduce__(self) -> tuple[Callable[[str], Effect], tuple[str]]:
        """Pickle an effect by its name, because compiled laws cannot be pickled."""
        return from_catalogue, (self.name,)


def from_catalogue(name: str) -> Effect:
    """The effect of the catalogue with this name."""
    return registered("rock2d.effects", "EFFECT")[name]
