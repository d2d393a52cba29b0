"""Forecasts of runout distances, their log scores, and tables that compare them with measurements, with intervals."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from rock2d.arrays import Array
from rock2d.field_tests.descents import Descents
from rock2d.field_tests.likelihood import Unknowns, log_density
from rock2d.files.field_releases import FieldReleases
from rock2d.statistics import wilson_interval

QUANTILES = (0.05, 0.10, 0.25, 0.50, 0.75, 0.90, 0.95)
QUANTILE_NAMES = ("q05", "q10", "q25", "q50", "q75", "q90", "q95")
SHOWN_PERCENTILES = (10.0, 50.0, 90.0)  # percentiles of the runout
FLOOR_DRAWS = 2000
ALL = "all"


@dataclass(frozen=True)
class Forecast:
    """Forecast distributions of the distances of n releases.

    Attributes
    ----------
    samples_m : (n, s) equally likely distances
    discrepancy_m : (n, s) standard deviation of the discrepancy of each sample
    caught : (n, s) probability that the block is caught anywhere on its way
    unresolved : share of the descents that were cut short or buried; they count as stopped there"""

    samples_m: Array
    discrepancy_m: Array
    caught: Array
    unresolved: float = 0.0

    def subset(self, indices: Array) -> Forecast:
        """The forecast of some of the releases."""
        return Forecast(self.samples_m[indices], self.discrepancy_m[indices], self.caught[indices], self.unresolved)

    def draws_m(self, rng: np.random.Generator) -> Array:
        """(n, s) draws of the distances, with discrepancy and caught blocks."""
        shape = self.samples_m.shape
        whole = np.maximum(self.samples_m + rng.standard_normal(shape) * self.discrepancy_m, 0.0)
        on_the_way = rng.random(shape) * self.samples_m
        return np.where(rng.random(shape) < self.caught, on_the_way, whole)

    def quantiles_m(self, rng: np.random.Generator) -> Array:
        """(n, quantiles) of the distance of each release."""
        return np.asarray(np.quantile(self.draws_m(rng), QUANTILES, axis=1).T)

    def log_scores(self, measured_m: Array) -> Array:
        """(n,) log of the density in 1/m at the measured distances."""
        return log_density(measured_m, self.samples_m, self.discrepancy_m, self.caught)


def forecast(
    unknowns: Unknowns, descents: Sequence[Descents], soils: Array, on_progress: Callable[[int], Any]
) -> Forecast:
    """Simulate releases with soils (s, d) of a posterior, in turn with `descents` of the same releases with different
    seeds.

    The distance of a block that does not start is replaced by another distance of the same release, or of the same
    kind of block."""
    releases, copies = descents[0].releases, descents[0].copies
    metres, unresolved = np.empty((len(releases), len(soils) * copies)), 0.0
    for i, (soil, some) in enumerate(zip(soils, itertools.cycle(descents), strict=False)):
        found = some.simulated(unknowns.scenario_of(soil))
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
    sd, caught = (
        np.tile(np.repeat(each, copies), (len(metres), 1))
        for each in (unknowns.discrepancy_m(soils), unknowns.caught(soils))
    )
    return Forecast(metres, sd, caught, unresolved)


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
    sd, caught = np.empty_like(samples), np.empty_like(samples)
    for indices, part in parts:
        samples[indices], sd[indices], caught[indices] = part.samples_m, part.discrepancy_m, part.caught
    unresolved = sum(part.unresolved * len(indices) for indices, part in parts) / n
    return Forecast(samples, sd, caught, unresolved)


def prediction_table(releases: FieldReleases, found: Forecast, rng: np.random.Generator) -> pd.DataFrame:
    """A row for each release: release, then the quantiles `QUANTILE_NAMES` of its horizontal distance in m."""
    table = pd.DataFrame(found.quantiles_m(rng), columns=list(QUANTILE_NAMES))
    table.insert(0, "release", releases.names)
    return table


@dataclass(frozen=True)
class PartForecast:
    """A forecast of some of the releases.

    Attributes
    ----------
    indices : (k,) indices of the releases
    forecast : that of these releases"""

    indices: Array
    forecast: Forecast


def by_block(releases: FieldReleases, own: PartForecast) -> dict[str, Array]:
    """Block -> rows of the forecast; `ALL` -> all rows."""
    blocks = [releases.blocks[i] for i in own.indices]
    rows = {block: np.flatnonzero(np.array(blocks) == block) for block in dict.fromkeys(blocks)}
    return rows | ({ALL: np.arange(len(own.indices))} if len(rows) > 1 else {})


def runout_table(
    releases: FieldReleases, forecasts: Mapping[str, PartForecast], rng: np.random.Generator
) -> pd.DataFrame:
    """Percentiles of the distance from start to stop, measured and forecast, for each block."""
    rows = []
    for name, own in forecasts.items():
        draws = own.forecast.draws_m(rng)
        for block, of_block in by_block(releases, own).items():
            measured = np.percentile(releases.distances_m[own.indices[of_block]], SHOWN_PERCENTILES)
            expected = np.percentile(draws[of_block], SHOWN_PERCENTILES)
            rows.append((name, block, len(of_block), *measured, *expected))
    kinds = [f"{kind}_q{p:.0f}_m" for kind in ("measured", "forecast") for p in SHOWN_PERCENTILES]
    return pd.DataFrame(rows, columns=["forecast", "block", "releases", *kinds])


def passing_table(
    releases: FieldReleases, forecasts: Mapping[str, PartForecast], lines_m: Array, rng: np.random.Generator
) -> pd.DataFrame:
    """Share of the releases that pass each distance, measured with its 95 % interval, and forecast."""
    rows = []
    for name, own in forecasts.items():
        draws = own.forecast.draws_m(rng)
        for block, of_block in by_block(releases, own).items():
            measured = releases.distances_m[own.indices[of_block]]
            for line in lines_m:
                passed, n = int((measured > line).sum()), len(of_block)
                low, high = wilson_interval(passed, n)
                rows.append((name, block, line, n, passed, passed / n, low, high, (draws[of_block] > line).mean()))
    columns = ["line_m", "releases", "passed", "measured", "low95", "high95", "forecast_frequency"]
    return pd.DataFrame(rows, columns=["forecast", "block", *columns])


def score_table(
    releases: FieldReleases, forecasts: Mapping[str, PartForecast], lines_m: Array, rng: np.random.Generator
) -> pd.DataFrame:
    """Scores of each forecast, for each block.

    median_error_m : forecast minus measured median of all releases of the block
    log_score, log_score_se : mean log of the density in 1/m at what was measured, and its standard error
    inside80, inside90 : share of the releases within their central 80 and 90 %, with Wilson's 95 % intervals
    passing_rmse, rmse_floor : root mean square error of the passing frequencies at the lines, and its median for a
        perfect model with so few releases
    unresolved : share of the forecast's descents that were cut short or buried; they count as stopped there"""
    rows: list[dict[str, Any]] = []
    for name, own in forecasts.items():
        draws, quantiles = own.forecast.draws_m(rng), own.forecast.quantiles_m(rng)
        scores = own.forecast.log_scores(releases.distances_m[own.indices])
        for block, of_block in by_block(releases, own).items():
            measured, n = releases.distances_m[own.indices[of_block]], len(of_block)
            row: dict[str, Any] = {"forecast": name, "block": block, "releases": n}
            row["median_error_m"] = float(np.median(draws[of_block]) - np.median(measured))
            row["log_score"] = float(scores[of_block].mean())
            row["log_score_se"] = float(scores[of_block].std(ddof=1) / np.sqrt(n)) if n > 1 else np.nan
            for share, low, high in ((80, 1, 5), (90, 0, 6)):
                inside = int(((measured >= quantiles[of_block, low]) & (measured <= quantiles[of_block, high])).sum())
                bounds = wilson_interval(inside, n)
                row |= {f"inside{share}": inside / n, f"inside{share}_low": bounds[0], f"inside{share}_high": bounds[1]}
            row["passing_rmse"], row["rmse_floor"] = _passing_rmse(measured, draws[of_block], lines_m, rng)
            row["unresolved"] = own.forecast.unresolved
            rows.append(row)
    return pd.DataFrame(rows)


def _passing_rmse(measured: Array, draws: Array, lines_m: Array, rng: np.random.Generator) -> tuple[float, float]:
    """Root mean square error of passing frequencies, and that of as many draws from the forecast itself."""
    expected = (draws[:, :, None] > lines_m).mean(axis=(0, 1))
    error = (measured[:, None] > lines_m).mean(axis=0) - expected
    picked = rng.integers(draws.shape[1], size=(FLOOR_DRAWS, len(draws)))
    drawn = draws[np.arange(len(draws)), picked]
    floor = (drawn[:, :, None] > lines_m).mean(axis=1) - expected
    return float(np.sqrt(np.mean(error**2))), float(np.median(np.sqrt(np.mean(floor**2, axis=1))))
