"""Distributions of numbers in a scenario file, and their quantiles."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Discriminator, Field, Tag, model_validator

from rock2d.arrays import Array
from rock2d.files.checked_yaml import Checked, did_you_mean, mistake, shown
from rock2d.files.places import is_number
from rock2d.files.setup_keys import Coordinate

Value = Annotated[float, Field(ge=-1.0e15, le=1.0e15)]


class NormalKeys(Checked):
    """Mean and standard deviation, in the unit of the key."""

    mean: Value = Field(description="Mean, in the unit of the key")
    sd: float = Field(ge=0, le=1e15, description="Standard deviation, in the unit of the key")


class UniformKeys(Checked):
    """Bounds, in the unit of the key."""

    low: Value = Field(description="Lower bound, in the unit of the key")
    high: Value = Field(description="Upper bound, in the unit of the key")

    @model_validator(mode="after")
    def _in_order(self) -> UniformKeys:
        if self.low > self.high:
            raise mistake(f"high must not be below low: {self.high:g} < {self.low:g}", "high")
        return self


class Normal(Checked):
    """Normal distribution."""

    normal: NormalKeys = Field(description="Mean and standard deviation")


class Uniform(Checked):
    """Uniform distribution."""

    uniform: UniformKeys = Field(description="Lower and upper bound")


class LognormalKeys(Checked):
    """Median, in the unit of the key, and coefficient of variation."""

    median: float = Field(gt=0, le=1e15, description="Median, in the unit of the key")
    cv: float = Field(gt=0, le=3, description="Standard deviation over the mean")

    @property
    def log_mean_sd(self) -> tuple[float, float]:
        """Mean and standard deviation of the logarithm."""
        return float(np.log(self.median)), float(np.sqrt(np.log1p(self.cv**2)))


class Lognormal(Checked):
    """Lognormal distribution, of quantities that are positive."""

    lognormal: LognormalKeys = Field(description="Median and coefficient of variation")


DISTRIBUTIONS = ("normal", "uniform", "lognormal")
EXPECTED_DISTRIBUTION = "{normal: {mean, sd}}, {uniform: {low, high}} or {lognormal: {median, cv}}"


def _refuse_unknown(value: Any, words: tuple[str, ...] = DISTRIBUTIONS, before: str = "") -> Any:
    """The value, if it is a mapping with one of these words as its only key; else raises a `mistake`."""
    if isinstance(value, Checked) or (isinstance(value, dict) and len(value) == 1 and value.keys() <= set(words)):
        return value
    found = shown(value)
    if isinstance(value, dict) and value:
        word = next((key for key in value if key not in words), None)
        found = f"key {shown(word)}{did_you_mean(word, words)}" if word else "several"
    raise mistake(f"expected {before}{EXPECTED_DISTRIBUTION}, found {found}")


def _kind(value: Any) -> str:
    if isinstance(value, dict):
        return f"<{next(iter(value), '')}>"
    return "<number>" if is_number(value) else f"<{type(value).__name__.lower()}>"


_NORMAL = Annotated[Normal, Tag("<normal>")]
_UNIFORM = Annotated[Uniform, Tag("<uniform>")]
_LOGNORMAL = Annotated[Lognormal, Tag("<lognormal>")]
ValueDistribution = Annotated[_NORMAL | _UNIFORM | _LOGNORMAL, Discriminator(_kind), BeforeValidator(_refuse_unknown)]
Draw = Annotated[
    Annotated[Coordinate, Tag("<number>")] | _NORMAL | _UNIFORM | _LOGNORMAL,
    Discriminator(_kind),
    BeforeValidator(lambda value: value if is_number(value) else _refuse_unknown(value, before="a number, ")),
]


class Times(Checked):
    """A factor on the value that the scenario gives."""

    times: ValueDistribution = Field(description="Distribution of the factor")


Variation = Annotated[
    _NORMAL | _UNIFORM | _LOGNORMAL | Annotated[Times, Tag("<times>")],
    Discriminator(_kind),
    BeforeValidator(lambda value: _refuse_unknown(value, (*DISTRIBUTIONS, "times"), "{times: a distribution}, ")),
]


def quantiles(draw: Any, u: Array | float, value: float) -> Array:
    """Quantiles `u` in (0, 1) of the distribution `draw`. A `Times` distribution multiplies `value`, which the scenario
    gives."""
    from scipy import stats

    if is_number(draw):
        return np.full(np.shape(u), float(draw))
    if isinstance(draw, Times):
        return np.asarray(value * quantiles(draw.times, u, 1.0))
    if isinstance(draw, Normal):
        return np.asarray(draw.normal.mean + draw.normal.sd * stats.norm.ppf(u))
    if isinstance(draw, Uniform):
        return np.asarray(draw.uniform.low + (draw.uniform.high - draw.uniform.low) * u)
    mean, sd = draw.lognormal.log_mean_sd
    return np.asarray(np.exp(mean + sd * stats.norm.ppf(u)))


def largest_magnitude(draw: Any) -> float:
    """Largest absolute value among the numbers of a draw: bounds, mean, standard deviation or median."""
    if not isinstance(draw, Checked):
        return abs(float(draw))
    numbers = next(iter(draw.model_dump().values()))
    return max(abs(value) for key, value in numbers.items() if key != "cv")
