"""Forecasts of runout distances, and their log scores."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from rock2d.field_tests.descents import Descents
from rock2d.field_tests.likelihood import Unknowns, log_density
from rock2d.files.field_releases import FieldReleases

if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray

QUANTILES = (0.05, 0.10, 0.25, 0.50, 0.75, 0.90, 0.95)
QUANTILE_NAMES = ("q05", "q10", "q25", "q50", "q75", "q90", "q95")


@dataclass(frozen=True)
class Forecast:
    """Forecast distributions of the distances of n releases.

    Attributes
    ----------
    samples_m : (n, s) equally likely distances
    kernel_m : (n, s) standard deviation of the discrepancy of each sample
    caught : (n, s) probability that the block is caught anywhere on its way
    unresolved : share of the descents that were cut short or buried; they count as stopped there
    """

    samples_m: Array
    kernel_m: Array
    caught: Array
    unresolved: float = 0.0

    def subset(self, indices: Array) -> Forecast:
        """The forecast of some of the releases."""
        return Forecast(
            self.samples_m[indices], self.kernel_m[indices], self.caught[indices], self.unresolved
        )

    def spread(self, rng: np.random.Generator) -> Array:
        """(n, s) draws of the distances, with discrepancy and caught blocks."""
        shape = self.samples_m.shape
        whole = np.maximum(self.samples_m + rng.standard_normal(shape) * self.kernel_m, 0.0)
        on_the_way = rng.random(shape) * self.samples_m
        return np.where(rng.random(shape) < self.caught, on_the_way, whole)

    def quantiles_m(self, rng: np.random.Generator) -> Array:
        """(n, quantiles) of the distance of each release."""
        return np.asarray(np.quantile(self.spread(rng), QUANTILES, axis=1).T)

    def log_scores(self, measured_m: Array) -> Array:
        """(n,) log of the density in 1/m at the measured distances."""
        return log_density(measured_m, self.samples_m, self.kernel_m, self.caught)


def forecast(
    unknowns: Unknowns,
    descents: Sequence[Descents],
    soils: Array,
    on_progress: Callable[[int], Any] = lambda count: None,
) -> Forecast:
    """Simulate releases with soils (s, d) of a posterior, in turn with `descents` of the same releases with different
    seeds.

    The distance of a block that does not start is replaced by another distance of the same release, or of the same
    kind of block.
    """
    releases, copies = descents[0].releases, descents[0].copies
    metres, unresolved = np.empty((len(releases), len(soils) * copies)), 0.0
    for i, (soil, some) in enumerate(zip(soils, itertools.cycle(descents), strict=False)):
        found = some.simulated(unknowns.soil(soil))
        metres[:, i * copies : (i + 1) * copies] = found.metres
        unresolved += float(found.unresolved.mean()) / len(soils)
        on_progress(1)
    rng = np.random.default_rng(np.random.SeedSequence(descents[0].seed, spawn_key=(len(soils),)))
    simulated = metres.copy()
    for i, row in enumerate(metres):
        missing = np.isnan(row)
        others = row if not missing.all() else simulated[releases.of_blocks(releases.blocks[i])]
        started = others[np.isfinite(others)]
        row[missing] = rng.choice(started, int(missing.sum())) if len(started) else 0.0
    kernel, caught = (
        np.tile(np.repeat(each, copies), (len(metres), 1))
        for each in (unknowns.discrepancy_m(soils), unknowns.caught(soils))
    )
    return Forecast(metres, kernel, caught, unresolved)


def naive_forecast(measured_m: Array, n: int) -> Forecast:
    """The naive forecast of n releases: the distances (m,) of others. Kernel width and caught share maximize the
    leave-one-out likelihood of these distances."""
    others = np.tile(measured_m, (len(measured_m), 1))
    np.fill_diagonal(others, np.nan)
    choices = itertools.product(np.geomspace(2.0, 40.0, 40), np.geomspace(0.005, 0.25, 12))
    width, caught = max(choices, key=lambda pair: log_density(measured_m, others, *pair).sum())
    shape = n, len(measured_m)
    return Forecast(np.tile(measured_m, (n, 1)), np.full(shape, width), np.full(shape, caught))


def joined(parts: Sequence[tuple[Array, Forecast]], n: int) -> Forecast:
    """One forecast of n releases from forecasts of parts of them (indices, forecast), with equal numbers of samples."""
    samples = np.empty((n, parts[0][1].samples_m.shape[1]))
    kernel, caught = np.empty_like(samples), np.empty_like(samples)
    for indices, part in parts:
        samples[indices], kernel[indices], caught[indices] = part.samples_m, part.kernel_m, part.caught
    unresolved = sum(part.unresolved * len(indices) for indices, part in parts) / n
    return Forecast(samples, kernel, caught, unresolved)


def prediction_table(releases: FieldReleases, found: Forecast, rng: np.random.Generator) -> pd.DataFrame:
    """A row for each release: release, then the quantiles `QUANTILE_NAMES` of its horizontal distance in m."""
    import pandas as pd

    table = pd.DataFrame(found.quantiles_m(rng), columns=list(QUANTILE_NAMES))
    table.insert(0, "release", releases.names)
    return table
