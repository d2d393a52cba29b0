"""The key `uncertainty` of a scenario: what is not known about the site, as distributions of single values."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from pydantic import Discriminator, Field, Tag

from rock2d.files.checked_yaml import Checked
from rock2d.files.scenario_keys import Normal, Uniform

Array = np.ndarray


class LognormalKeys(Checked):
    """Median, in the unit of the key, and coefficient of variation."""

    median: float = Field(gt=0, le=1e15, description="Median, in the unit of the key")
    cv: float = Field(gt=0, le=3, description="Standard deviation over the mean")


class Lognormal(Checked):
    """Lognormal distribution, of quantities that are positive."""

    lognormal: LognormalKeys = Field(description="Median and coefficient of variation")


def _kind(value: Any) -> str:
    names = ("times", "normal", "uniform", "lognormal")
    if isinstance(value, dict):
        return next((f"<{name}>" for name in names if name in value), "<uniform>")
    return f"<{type(value).__name__.lower()}>"


_NORMAL = Annotated[Normal, Tag("<normal>")]
_UNIFORM = Annotated[Uniform, Tag("<uniform>")]
_LOGNORMAL = Annotated[Lognormal, Tag("<lognormal>")]
ValueDistribution = Annotated[_NORMAL | _UNIFORM | _LOGNORMAL, Discriminator(_kind)]


class Times(Checked):
    """A factor on the value that the scenario gives."""

    times: ValueDistribution = Field(description="Distribution of the factor")


SiteDraw = Annotated[_NORMAL | _UNIFORM | _LOGNORMAL | Annotated[Times, Tag("<times>")], Discriminator(_kind)]


class Uncertainty(Checked):
    """What is not known about the site."""

    sites: int = Field(
        default=32,
        ge=4,
        le=4096,
        description="Base number of possible sites, rounded up to a power of two; with d unknown values, "
        "sites x (d + 2) are simulated",
    )
    releases: int = Field(
        default=300, ge=20, le=100_000, description="Releases of each block on each of these sites"
    )
    site: dict[str, SiteDraw] = Field(
        min_length=1,
        max_length=50,
        description="Place of a number in this file, for example model.deterministic.default.k_l_N_m, -> its "
        "distribution, or {times: distribution of a factor}",
    )


def quantiles(draw: Any, u: Array, value: float) -> Array:
    """Values at the shares `u` in (0, 1) of the distribution of a quantity that the scenario gives as `value`."""
    from scipy import stats

    if isinstance(draw, Times):
        return np.asarray(value * quantiles(draw.times, u, 1.0))
    if isinstance(draw, Normal):
        return np.asarray(draw.normal.mean + draw.normal.sd * stats.norm.ppf(u))
    if isinstance(draw, Uniform):
        return np.asarray(draw.uniform.low + (draw.uniform.high - draw.uniform.low) * u)
    sigma = np.sqrt(np.log1p(draw.lognormal.cv**2))
    return np.asarray(draw.lognormal.median * np.exp(sigma * stats.norm.ppf(u)))
