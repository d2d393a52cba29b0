"""A table of impacts as arrays: the states before the impacts and the velocities after them."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Self

import numpy as np

from rock2d.files.experiment import Experiment
from rock2d.kinematics.impacts import release_order
from rock2d.records.columns import POSITION
from rock2d.scene.nearest_facet import nearest_facets

Array = np.ndarray

BEFORE_COLUMNS = ("x_m", "y_m", "theta_rad", "vx_m_s", "vy_m_s", "omega_rad_s")
AFTER_COLUMNS = ("vx_after_m_s", "vy_after_m_s", "omega_after_rad_s")
VELOCITY_AFTER, SPIN_AFTER = slice(0, 2), 2  # columns of `ImpactTable.after`


@dataclass
class ImpactTable:
    """Impacts of a table.

    Attributes
    ----------
    before : (n, 6) recorded states before the impacts
    after : (n, 3) recorded velocities (vx, vy, omega) after them
    impact_block, impact_zone, impact_release : (n,) index of block, zone and release of each impact
    tangent : (n, 2) direction of the nearest facet
    impact_order : (n,) place of each impact's release in its block's series
    order : (releases,) place of each release in its block's series
    """

    before: Array
    after: Array
    impact_block: Array
    impact_zone: Array
    tangent: Array
    impact_release: Array
    impact_order: Array
    order: Array

    @classmethod
    def of(cls, experiment: Experiment) -> Self:
        """Impacts of an experiment with an impact table; rows without a state after are left out."""
        table = experiment.impacts
        assert table is not None
        columns, after = list(BEFORE_COLUMNS), list(AFTER_COLUMNS)
        table = table.dropna(subset=[*columns, *after]).sort_values("release", kind="stable")
        names = list(experiment.blocks)
        releases, index = np.unique(table["release"].to_numpy(), return_inverse=True)
        block = table["block"].map({name: i for i, name in enumerate(names)}).to_numpy(np.int64)
        first = np.searchsorted(index, np.arange(len(releases)))
        before = table[columns].to_numpy(float)
        cross_section = experiment.cross_section
        facet = nearest_facets(before[:, POSITION], cross_section.points_m)
        order = release_order(block[first]).astype(float)
        return cls(
            before, table[after].to_numpy(float), block, cross_section.zone_ids[facet], cross_section.tangents[facet],
            index, order[index], order,
        )  # fmt: skip

    @property
    def release_block(self) -> Array:
        """(releases,) index of the block of each."""
        return self.impact_block[np.unique(self.impact_release, return_index=True)[1]]

    def only(self, releases: Array) -> Self:
        """The impacts of some of the releases, given as a mask; releases keep their numbers."""
        own = releases[self.impact_release]
        rows = {f.name: getattr(self, f.name)[own] for f in fields(self) if f.name != "order"}
        return replace(self, **rows)
