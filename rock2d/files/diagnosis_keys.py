"""The keys of diagnosis.json. `DiagnosisFile` describes everything that `rock2d diagnose` writes.

It checks what is written and what is read, and gives the JSON Schema. Keys that are newer than schema 1 are optional,
so that older files stay readable."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Discriminator, Field, Tag, model_validator

from rock2d.files.checked_yaml import key_shown, mistake
from rock2d.files.experiment import FromGravity
from rock2d.files.fitted_keys import (
    FittedLaw,
    Gain,
    GainError,
    Interval,
    JointFit,
    JointModel,
    NotNegative,
    Number,
    Parameters,
    Part,
)
from rock2d.files.setup_keys import CrossSectionKeys

Probability = Annotated[float, Field(ge=0, le=1)]
Count = Annotated[int, Field(ge=0)]
EffectName = Annotated[str, Field(description="Name of the effect")]


class TriedEffect(Part):
    """An effect that was fitted together with the law."""

    parameters: Parameters
    base: FittedLaw | None = Field(default=None, description="The law's parameters as fitted together with this effect")
    heldout_score_gain: Gain
    heldout_score_gain_se: GainError
    closure: Number = Field(description="Share of the gap that it closes, on releases that no fit saw")
    closure_ci95: Interval


class Cell(Part):
    """A part of the gap."""

    phase: Literal["flight", "impact", "rest"] = Field(description="Phase of the motion")
    zone: str = Field(description="Zone of the cross-section")
    block: str = Field(description="Name of the block")
    channel: Literal["x", "y", "theta", "normal", "tangential", "spin"] = Field(description="What is compared")
    share: Probability = Field(description="Share of the gap above noise")
    z: Number = Field(description="The same in standard errors")
    base: Number | None = Field(
        default=None, description="Typical residual of the base law there, in standard deviations"
    )
    augmented: Number | None = Field(default=None, description="The same of the best model")


class Gap(Part):
    """How far the gap shrinks, on releases that no fit saw; null where nothing could be tried."""

    unit: str = Field(description="Unit of base, augmented and noise_floor, in words")
    base: Number | None = Field(description="Gap of the refitted base law")
    augmented: Number | None = Field(description="Gap of the best law with its effects")
    noise_floor: Number | None = Field(description="What even a perfect model would miss")
    closure: Number | None = Field(description="(base - augmented) / (base - noise_floor)")
    closure_ci95: Interval | None = Field(description="Its 95 % interval")


class Common(Part):
    """What effects that the data cannot tell apart have in common."""

    name: str = Field(description="Name of the quantity")
    value: Number = Field(description="Its value")
    ci95: Interval
    unit: str = Field(description="Its unit")


class Cause(Part):
    """An effect that acts with a probability of 0.05 or more."""

    effect: EffectName
    p: Probability = Field(description="Probability that it is one of the causes; from 0.5 on it is part of the model")
    parameters: Parameters
    origin: Literal["camera", "flight", "block", "ground", "impact law"] | None = Field(
        default=None, description="Where the cause comes from"
    )
    group: list[str] = Field(default=[], description="Effects that these data cannot tell from it")
    closes: Number | None = Field(
        description="Share of the base gap that it closes, mean over all orders of the causes; null if it is no part "
        "of the model"
    )
    closes_ci95: Interval | None = Field(description="Its 95 % interval")
    closes_range: Interval | None = Field(default=None, description="Smallest and largest share over the orders")
    named: bool | None = Field(
        default=None, description="Beyond doubt, and closes a share that is surely above 0 (schema 3)"
    )
    common: Common | None = Field(default=None, description="What its group has in common (schema 3)")


class LearntShare(Part):
    """What the learnt changes close."""

    closes: Number = Field(description="Share of the base gap")
    closes_ci95: Interval
    changes: list[str] = Field(default=[], description="What changes with what")
    effects: list[str] = Field(
        default=[],
        description="Effects of the catalogue that act with these changes because predictions are better with them, "
        "although they are not probable",
    )


class Outside(Part):
    """What depends on something that no cause explains, and what was learnt."""

    p: Probability = Field(description="Probability that something outside the catalogue acts")
    share: Number = Field(description="Share of the base gap that depends on something, learnt changes included")
    share_ci95: Interval | None = Field(default=None, description="Its 95 % interval")
    depends_on: list[str] = Field(description="What it depends on, the strongest first")
    learnt: LearntShare | None = Field(description="What the learnt changes close; null if nothing was learnt")


class Floor(Part):
    """What no model can close, in the unit of the gap."""

    regression: Number = Field(description="What a flexible regression leaves")
    replicates: Number = Field(description="What near-replicates leave")
    used: Number = Field(description="The floor of the gap: the lowest of these and of the model")


class Dependence(Part):
    """A dependence that remains beside the best effect."""

    dependence: str = Field(description="What depends on what")
    heldout_score_gain: Gain
    heldout_score_gain_se: GainError


class Beside(JointFit):
    """An effect found beside the verdict, and the joint fit of all effects up to it."""

    effect: EffectName
    heldout_score_gain: Gain
    heldout_score_gain_se: GainError


class Reading(Part):
    """Which reading of the paper's law the data chose."""

    old_keys: ClassVar[Mapping[str, str]] = {"rolling_in_crater": "rolling_in_indentation"}
    rolling_in_indentation: bool = Field(
        default=False,
        description="The rolling spring acts until the block is clear of the ground; false: only while the ground "
        "presses",
    )
    fitted: bool = Field(
        default=True, description="Whether impacts determined the law; false: it is the paper's, scaled to the blocks"
    )


class BlockScale(Part):
    """A block of the experiment."""

    mass_kg: float = Field(gt=0, le=1.0e12, description="Mass in kg")
    size_m: float = Field(gt=0, le=1.0e6, description="Diameter of the circle of equal area in m")
    shape: str | None = Field(default=None, description="Name of its shape")


def fitted_scale(blocks: Mapping[str, BlockScale]) -> tuple[float, float] | None:
    """Mean size in m and mean mass in kg of the blocks of a diagnosis, as in `World`; None without blocks."""
    if not blocks:
        return None
    sizes_m, masses_kg = zip(*((block.size_m, block.mass_kg) for block in blocks.values()), strict=True)
    return float(np.mean(sizes_m)), float(np.mean(masses_kg))


class FrameRate(Part):
    """A frame rate."""

    value: NotNegative = Field(description="Frames per second")
    ci95: Interval


class FilmGravity(Part):
    """Gravity as the flights show it, and what follows for scale and frame rate."""

    value_m_s2: NotNegative = Field(description="Size of the acceleration in flight in m/s²")
    error_m_s2: NotNegative = Field(description="Its standard error; 1.96 of them make the 95 % interval")
    ci95_m_s2: Interval
    stated_m_s2: NotNegative = Field(description="Gravity as stated")
    flights: Count = Field(description="Flights that show it")
    releases: Count = Field(description="Releases that show it")
    left_out: Count = Field(
        default=0, description="Flights that are too short or too straight, or that differ from the others"
    )
    position_noise_m: NotNegative = Field(default=0.0, description="Noise of a position in a frame, 1 sigma, in m")
    instant_noise_s: NotNegative = Field(default=0.0, description="Noise of the instant of a frame, 1 sigma, in s")
    slow_errors: bool = Field(
        default=False, description="Errors that change slowly along a flight decide the standard error"
    )
    air_share: Number = Field(
        default=0.0,
        description="Share of gravity by which the air would change it, for bodies of the stated mass and size",
    )
    tilt_rad: Number = Field(
        default=0.0, description="Angle of the picture against the vertical of the flights, counter-clockwise, in rad"
    )
    tilt_ci95_rad: Interval | None = Field(default=None, description="Its 95 % interval")
    off: bool = Field(
        description="Scale or frame rate must be wrong: gravity is off by more than its error, air and place explain"
    )
    effects: list[str] = Field(
        description="Effects of which at least one acts and that flights cannot tell apart; empty if off is false"
    )
    parameters: dict[str, Parameters] = Field(
        description="Parameter of scale_error and of frame_rate_error, if it acts alone"
    )
    true_fps: FrameRate | None = Field(default=None, description="Frame rate with which gravity comes out as stated")


class FilmRest(Part):
    """Where a block lies at rest."""

    block: str = Field(description="Name of the block")
    rests: Count = Field(description="Releases that end at rest")
    height_m: Number = Field(description="Height of the side on which it lies above the stated ground in m, mean")
    error_m: NotNegative | None = Field(description="Its standard error; null of a single release")
    height_radii: Number = Field(description="The height over the radius of the block")


class FilmSays(Part):
    """What the film says of itself, before any model of contact."""

    gravity: FilmGravity | None = Field(
        description="Gravity as the flights show it; null if no flight shows it, or if it was not measured"
    )
    from_gravity: FromGravity | None = Field(
        default=None,
        description="Frame rate or scale if the fall of the blocks gave it: gravity is then no measurement",
    )
    rests: list[FilmRest] = Field(description="Where blocks lie at rest")
    without_angle: list[str] = Field(
        description="Blocks whose angle was not measured in some release: their spin is unknown"
    )
    said: list[str] = Field(description="The same in words")


class Check(Part):
    """A predictive check among replicates of the diagnosed model."""

    name: str = Field(description="Name of the check")
    words: str = Field(description="What is compared, in words")
    value: Number = Field(description="Value of the film")
    replicates: list[Number] = Field(
        min_length=3, max_length=3, description="Quantiles 0.05, 0.5 and 0.95 of the replicates"
    )
    p: Probability = Field(description="Share of the replicates that are as far out, or probability of so many")


class Limit(Part):
    """The sizes of an effect that these data can see, from injection and recovery."""

    seen50: Number = Field(description="Size that is found with probability 0.5")
    seen90: Number = Field(description="Size that is found with probability 0.9")
    upper95: Number | None = Field(description="Upper limit of its size; null if the effect was found")
    unit: str = Field(description="Unit of the sizes")


class BothModels(Part):
    """A miss of both models."""

    base: Number = Field(description="Miss of the base law")
    augmented: Number = Field(description="Miss of the diagnosed model")


class Typical(BothModels):
    """The typical segment."""

    floor: Number = Field(description="What even a perfect model would miss")
    closure: Number | None = Field(
        description="(base - augmented) / (base - floor); null if its standard error is above 0.15"
    )
    closure_ci95: Interval


class Predicted(Part):
    """What `rock2d predict` reaches on held-out releases, whole segments."""

    typical: Typical
    tail: BothModels
    units: dict[str, Number] = Field(description="Unit to the size of one unit of the miss, for example mm")


class SanityFindings(Part):
    """What the sanity checks found."""

    faults: list[str] = Field(default=[], description="Reasons why the experiment could not be diagnosed")
    fault_codes: list[str] = Field(default=[], description="The code of each fault, for programs")
    remarks: list[str] = Field(default=[], description="What the user should know")


Base = Annotated[
    Annotated[FittedLaw, Tag("law")] | Annotated[dict[str, Number], Field(max_length=0), Tag("none")],
    Discriminator(lambda value: "none" if value == {} else "law"),
]


class DiagnosisFile(Part):
    """What `rock2d diagnose` found: where the simulation of an experiment is wrong, which effect is missing, how far
    the gap shrinks. SI units."""

    schema_: int = Field(
        alias="schema",
        ge=1,
        description="Version of this format; causes, outside and floor came with 2, common quantities with 3",
    )
    experiment: str = Field(description="Name of the experiment")
    base: Base = Field(
        description="The paper's law after its own parameters were refitted; empty if the experiment could not be "
        "diagnosed"
    )
    law: Reading = Reading()
    verdict: str = Field(description="The likeliest single answer: the name of an effect, none, or unknown")
    group: list[str] = Field(
        description="Effects that the data cannot tell from the verdict, the verdict included; empty if the verdict is "
        "none or unknown"
    )
    probabilities: dict[str, Probability] = Field(
        description="Probability of none, of unknown and of every effect of the catalogue; they sum to 1"
    )
    effects: dict[str, TriedEffect] = Field(description="Every effect that was tried, fitted with the law")
    where: list[Cell] = Field(description="Where the gap lies, largest share first; shares sum to 1")
    gap: Gap
    causes: list[Cause] = Field(
        default=[], description="Effects that act with a probability of 0.05 or more, most probable first"
    )
    outside: Outside | None = Field(
        default=None, description="What depends on something that no cause explains, and what was learnt"
    )
    floor: Floor | None = Field(default=None, description="What no model can close, in the unit of the gap")
    next_release: str = Field(default="", description="The release that would best split the group, in words")
    unexplained: list[Dependence] = Field(
        default=[],
        description="Dependences that remain beside the best effect and that no effect of the catalogue may explain",
    )
    beside: list[Beside] = Field(default=[], description="Effects found beside the verdict, all in one joint fit")
    model: JointModel | None = Field(
        default=None,
        description="The joint fit of all causes, also beside an unknown one; null without causes and learnt changes",
    )
    series: dict[str, Count] = Field(default={}, description="Number of filmed releases of each block")
    blocks: dict[str, BlockScale] = Field(
        default={},
        description="The blocks of the experiment: the scale at which the parameters hold. Their mean size and mass "
        "are the units of parameters over the blocks' size or mass",
    )
    cross_section: CrossSectionKeys | None = Field(
        default=None, description="The ground of the experiment, without measure lines"
    )
    gravity_m_s2: float | None = Field(default=None, ge=0, le=1000, description="Gravity of the experiment in m/s²")
    assumptions: list[str] = Field(default=[], description="What the diagnosis assumed, in words")
    unseen: dict[str, str] | None = Field(
        default=None, description="Effects that these data cannot show, so that they were not tried, and why"
    )
    film: FilmSays | None = Field(
        default=None,
        description="What the film says of itself; null of a table of impacts and of a film that cannot be read",
    )
    sanity: SanityFindings = SanityFindings()
    physical: dict[Literal["m_s", "mm", "deg"], BothModels] = Field(
        default={},
        description="Unit to the median miss of held-out releases: m_s of the velocity after an impact, mm and deg at "
        "the end of a segment (schema 3)",
    )
    checks: list[Check] = Field(default=[], description="Predictive checks (schema 3)")
    limits: dict[str, Limit] | None = Field(
        default=None, description="Effect to the sizes that these data can see (schema 3)"
    )
    predicted: Predicted | None = Field(
        default=None, description="What predictions reach on held-out releases (schema 3)"
    )

    @model_validator(mode="after")
    def _has_probability_of_verdict(self) -> DiagnosisFile:
        if self.verdict not in self.probabilities:
            message = f"the probability of the verdict {key_shown(self.verdict)} is missing"
            raise mistake(message, "probabilities", at="key", code="missing_key", key=self.verdict)
        for effect in self.effects.values():
            if effect.base is None and self.fitted_law is not None:
                effect.base = self.fitted_law  # in files of schema 1, effects may lack a law
        return self

    @property
    def fitted_law(self) -> FittedLaw | None:
        """The refitted law; None if the experiment could not be diagnosed."""
        return self.base if isinstance(self.base, FittedLaw) else None

    def content(self) -> dict[str, Any]:
        """The keys that the file has, with their present names."""
        return self.model_dump(by_alias=True, exclude_unset=True)
