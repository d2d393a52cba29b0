"""The key `uncertainty` of a scenario: what is not known about the site, as distributions of single values."""

from __future__ import annotations

from pydantic import Field

from rock2d.files.checked_yaml import Checked
from rock2d.files.distributions import Variation


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
    site: dict[str, Variation] = Field(
        default={},
        max_length=50,
        description="Place of a number in this file, for example model.deterministic.default.k_l_N_m, -> its "
        "distribution, or {times: distribution of a factor}; may be left out where model.diagnosis leaves values open",
    )
    posterior: str | None = Field(
        default=None,
        description="Table (CSV) beside this file: a column for each place, a row for each of equally likely draws, "
        "for example of a calibration; a site takes a row whole",
    )
