"""Tables that compare forecasts of a field test with measurements, with intervals."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from rock2d.field_tests.forecasts import Forecast
from rock2d.files.field_releases import FieldReleases
from rock2d.statistics import wilson_interval

if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray

SHOWN_PERCENTILES = (10.0, 50.0, 90.0)  # percentiles of the runout
FLOOR_DRAWS = 2000
ALL = "all"


@dataclass(frozen=True)
class Forecasts:
    """A forecast of some of the releases.

    Attributes
    ----------
    indices : (k,) indices of the releases
    found : their forecast
    """

    indices: Array
    found: Forecast


def by_block(releases: FieldReleases, own: Forecasts, among_all: bool = True) -> dict[str, Array]:
    """Block -> rows of the forecast; `ALL` -> all rows."""
    blocks = [releases.blocks[i] for i in own.indices]
    rows = {block: np.flatnonzero(np.array(blocks) == block) for block in dict.fromkeys(blocks)}
    return rows | ({ALL: np.arange(len(own.indices))} if among_all and len(rows) > 1 else {})


def runout_table(
    releases: FieldReleases, forecasts: Mapping[str, Forecasts], rng: np.random.Generator
) -> pd.DataFrame:
    """Percentiles of the distance from start to stop, measured and forecast, for each block."""
    import pandas as pd

    rows = []
    for name, own in forecasts.items():
        spread = own.found.spread(rng)
        for block, of_block in by_block(releases, own).items():
            measured = np.percentile(releases.distances_m[own.indices[of_block]], SHOWN_PERCENTILES)
            expected = np.percentile(spread[of_block], SHOWN_PERCENTILES)
            rows.append((name, block, len(of_block), *measured, *expected))
    kinds = [f"{kind}_q{p:.0f}_m" for kind in ("measured", "forecast") for p in SHOWN_PERCENTILES]
    return pd.DataFrame(rows, columns=["forecast", "block", "releases", *kinds])


def passing_table(
    releases: FieldReleases, forecasts: Mapping[str, Forecasts], lines_m: Array, rng: np.random.Generator
) -> pd.DataFrame:
    """Share of the releases that pass each distance, measured with its 95 % interval, and forecast."""
    import pandas as pd

    rows = []
    for name, own in forecasts.items():
        spread = own.found.spread(rng)
        for block, of_block in by_block(releases, own).items():
            measured = releases.distances_m[own.indices[of_block]]
            for line in lines_m:
                passed, n = int((measured > line).sum()), len(of_block)
                low, high = wilson_interval(passed, n)
                rows.append(
                    (name, block, line, n, passed, passed / n, low, high, (spread[of_block] > line).mean())
                )
    columns = ["line_m", "releases", "passed", "measured", "low95", "high95", "forecast_frequency"]
    return pd.DataFrame(rows, columns=["forecast", "block", *columns])


def score_table(
    releases: FieldReleases, forecasts: Mapping[str, Forecasts], lines_m: Array, rng: np.random.Generator
) -> pd.DataFrame:
    """Scores of each forecast, for each block.

    median_error_m : forecast minus measured median of all releases of the block
    log_score, log_score_se : mean log of the density in 1/m at what was measured, and its standard error
    inside80, inside90 : share of the releases within their central 80 and 90 %, with Wilson's 95 % intervals
    passing_rmse, rmse_floor : root mean square error of the passing frequencies at the lines, and its median for a
        perfect model with so few releases
    unresolved : share of the forecast's descents that were cut short or buried; they count as stopped there
    """
    import pandas as pd

    rows: list[dict[str, Any]] = []
    for name, own in forecasts.items():
        spread, quantiles = own.found.spread(rng), own.found.quantiles_m(rng)
        scores = own.found.log_scores(releases.distances_m[own.indices])
        for block, of_block in by_block(releases, own).items():
            measured, n = releases.distances_m[own.indices[of_block]], len(of_block)
            row: dict[str, Any] = {"forecast": name, "block": block, "releases": n}
            row["median_error_m"] = float(np.median(spread[of_block]) - np.median(measured))
            row["log_score"] = float(scores[of_block].mean())
            row["log_score_se"] = float(scores[of_block].std(ddof=1) / np.sqrt(n)) if n > 1 else np.nan
            for share, low, high in ((80, 1, 5), (90, 0, 6)):
                inside = int(
                    ((measured >= quantiles[of_block, low]) & (measured <= quantiles[of_block, high])).sum()
                )
                bounds = wilson_interval(inside, n)
                row |= {
                    f"inside{share}": inside / n,
                    f"inside{share}_low": bounds[0],
                    f"inside{share}_high": bounds[1],
                }
            row["passing_rmse"], row["rmse_floor"] = _passing_rmse(measured, spread[of_block], lines_m, rng)
            row["unresolved"] = own.found.unresolved
            rows.append(row)
    return pd.DataFrame(rows)


def _passing_rmse(
    measured: Array, spread: Array, lines_m: Array, rng: np.random.Generator
) -> tuple[float, float]:
    """Root mean square error of passing frequencies, and that of as many draws from the forecast itself."""
    expected = (spread[:, :, None] > lines_m).mean(axis=(0, 1))
    error = (measured[:, None] > lines_m).mean(axis=0) - expected
    picked = rng.integers(spread.shape[1], size=(FLOOR_DRAWS, len(spread)))
    drawn = spread[np.arange(len(spread)), picked]
    floor = (drawn[:, :, None] > lines_m).mean(axis=1) - expected
    return float(np.sqrt(np.mean(error**2))), float(np.median(np.sqrt(np.mean(floor**2, axis=1))))
