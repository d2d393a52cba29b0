"""The keys of a scenario for what varies from release to release (populations of blocks, rough ground) and for what is
not known about the site."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from rock2d.arrays import Array
from rock2d.files.checked_yaml import Checked, mistake
from rock2d.files.distributions import Draw, Variation, quantiles
from rock2d.scene.blocks import Block, make_block
from rock2d.scene.rough_ground import Roughness

DRAWS_OF_A_BLOCK = 4  # random numbers that a block of a population takes
WITH_ASPECT = ("rectangle", "ellipse")
SCATTERED = ("model", "blocks")  # keys of a scenario whose numbers may vary from release to release


class RoughnessKeys(Checked):
    """How rough the ground of a zone is; each release has its own surface."""

    sd_deg: float = Field(gt=0, le=20, description="Standard deviation of the local slope in degrees")
    length_m: Annotated[float, Field(ge=1e-4, le=1e3)] = Field(description="Length of a piece of constant slope in m")

    def make(self) -> Roughness:
        """The roughness, in SI."""
        return Roughness(float(np.deg2rad(self.sd_deg)), self.length_m)


class Family(Checked):
    """Blocks of one profile."""

    shape: Literal["circle", "square", "rectangle", "ellipse"] = Field(description="Profile")
    aspect: Draw = Field(default=1.0, description="Length over height, of a rectangle or an ellipse")
    weight: float = Field(default=1.0, gt=0, le=1e6, description="How frequent this family is among all")

    @model_validator(mode="after")
    def _has_an_aspect(self) -> Family:
        if "aspect" in self.model_fields_set and self.shape not in WITH_ASPECT:
            raise mistake(f"only {' and '.join(WITH_ASPECT)} have an aspect", "aspect", at="key")
        return self


class Population(Checked):
    """Blocks that differ from release to release in size, density and profile."""

    size_m: Draw = Field(
        description="Diameter of the circle of equal area in m; the volume is that of a ball of this diameter"
    )
    density_kg_m3: Draw = Field(default=2700.0, description="Density in kg/m³")
    families: list[Family] = Field(
        default_factory=lambda: [Family(shape="circle")],
        min_length=1,
        max_length=50,
        description="Profiles, each with its weight",
    )

    @model_validator(mode="after")
    def _is_possible(self) -> Population:
        for key, most in (("size_m", 1e3), ("density_kg_m3", 1e5)):
            low, high = quantiles(getattr(self, key), np.array([1e-6, 1 - 1e-6]), 0.0)
            if not 0 < low <= high <= most:
                raise mistake(f"expected values between 0 and {most:g}, found {low:.3g} to {high:.3g}", key)
        for i, family in enumerate(self.families):
            low, high = quantiles(family.aspect, np.array([1e-6, 1 - 1e-6]), 0.0)
            if not 0.05 <= low <= high <= 20:
                message = f"expected an aspect between 0.05 and 20, found {low:.3g} to {high:.3g}"
                raise mistake(message, "families", i, "aspect")
        return self

    def block(self, name: str, u: Array) -> Block:
        """The block at the quantiles u (4,) in (0, 1) of size, density, family and aspect."""
        weights = np.cumsum([family.weight for family in self.families])
        family = self.families[int(np.searchsorted(weights, u[2] * weights[-1], side="right"))]
        size, density, aspect = (
            float(quantiles(draw, u[i], 0.0))
            for draw, i in ((self.size_m, 0), (self.density_kg_m3, 1), (family.aspect, 3))
        )
        return block_of_size(name, family.shape, size, aspect, density)

    def median_block(self, name: str) -> Block:
        """The block of median size and density, of the first family."""
        return self.block(name, np.array([0.5, 0.5, 0.0, 0.5]))


def block_of_size(name: str, shape: str, size_m: float, aspect: float, density_kg_m3: float) -> Block:
    """A block of a family.

    Parameters
    ----------
    shape : a shape of `Family`
    size_m : diameter of the circle of equal area; the block has the volume of a ball of this diameter
    aspect : length over height, of a rectangle or an ellipse

    Raises BlockError if a size makes no sense."""
    mass_kg = density_kg_m3 * np.pi / 6 * size_m**3
    if shape == "circle":
        return make_block(name, shape, mass_kg, "solid_sphere", diameter_m=size_m)
    if shape == "square":
        return make_block(name, shape, mass_kg, side_m=size_m * np.sqrt(np.pi) / 2)
    height_m = size_m / np.sqrt(aspect) * (np.sqrt(np.pi) / 2 if shape == "rectangle" else 1.0)
    return make_block(name, shape, mass_kg, length_m=aspect * height_m, height_m=height_m)


class Uncertainty(Checked):
    """What is not known about the site."""

    sites: int = Field(
        default=32,
        ge=4,
        le=4096,
        description="Base number of possible sites, rounded up to a power of two; with d unknown values, "
        "rock2d run simulates sites x (d + 2), rock2d design 2 x sites",
    )
    releases: int = Field(default=300, ge=20, le=100_000, description="Releases of each block on each of these sites")
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

    @property
    def base_sites(self) -> int:
        """`sites`, rounded up to a power of two."""
        return 1 << (self.sites - 1).bit_length()
