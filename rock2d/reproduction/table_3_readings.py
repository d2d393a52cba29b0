"""Readings of Table 3: with which of them does it reproduce the sphere's row of the paper's probabilistic column?

The paper gives neither the angle of the facing nor the tilt of the measure lines, and may define its threshold M½ of
the momentum differently. Each reading limits these three. Within the limits, set-up and arrival are free to explain
the sphere's first impacts and passing frequencies with the parameters of Table 3. The sphere has no slope reduction, so
all other quantities are known."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import pandas as pd

from rock2d.arrays import Array
from rock2d.calibration.sequential_monte_carlo import Factor, Space
from rock2d.reproduction import published, summary
from rock2d.reproduction.calibrations import (
    Draws,
    Effort,
    Model,
    OnProgress,
    calibrate,
    cells_factor,
    first_impacts_factor,
    standard_normal_draws,
)
from rock2d.reproduction.hypotheses import SETUP_QUANTITIES, Values, arrival_quantities, table_3
from rock2d.reproduction.outcomes import Outcome, probabilistic_outcome

BLOCK = "sphere"
SHARE_OF_HYPOTHESES = 0.5  # of those of a calibration; one block has fewer unknowns
PREDICTION_RELEASES = 128  # per hypothesis
SIGNIFICANT = 0.05


@dataclass(frozen=True)
class Reading:
    """Ranges of the quantities that Table 3 does not define.

    Attributes
    ----------
    facing_deg : angle of the facing
    line_tilt_deg : tilt of the measure lines from the vertical
    momentum_factor : factor on both thresholds M½ of Table 3"""

    name: str
    facing_deg: tuple[float, float]
    line_tilt_deg: tuple[float, float]
    momentum_factor: float = 1.0

    @property
    def space(self) -> Space:
        """The prior of set-up and arrival within the reading."""
        ranges = {"facing_deg": self.facing_deg, "line_tilt_deg": self.line_tilt_deg}
        setup = (
            replace(q, low=ranges[q.name][0], high=ranges[q.name][1]) if q.name in ranges else q
            for q in SETUP_QUANTITIES
        )
        return Space((*setup, *arrival_quantities(BLOCK)))


STEEP, GENTLE, NEARLY_UPRIGHT, LEANING = (55.0, 75.0), (35.0, 55.0), (0.0, 30.0), (30.0, 90.0)
READINGS = (
    Reading("steep facing and nearly upright lines", STEEP, NEARLY_UPRIGHT),
    Reading("gentle facing", GENTLE, NEARLY_UPRIGHT),
    Reading("leaning lines", STEEP, LEANING),
    Reading("three times the momentum", STEEP, NEARLY_UPRIGHT, 3.0),
)


def compute_readings(
    effort: Effort, seed: np.random.SeedSequence, on_progress: OnProgress, readings: Sequence[Reading] = READINGS
) -> dict[str, Array]:
    """The posterior of each reading: `percent` (readings, k, lines) that pass, `p` (readings, lines) of the paper's
    numbers, `facing_deg` and `line_tilt_deg` (readings, k)."""
    effort = replace(effort, hypotheses=round(SHARE_OF_HYPOTHESES * effort.hypotheses))
    paper = published.passed(published.PROBABILISTIC)[published.BLOCKS.index(BLOCK)]
    found: dict[str, list[Array]] = {"percent": [], "p": [], "facing_deg": [], "line_tilt_deg": []}
    for done, (reading, own) in enumerate(zip(readings, seed.spawn(len(readings)), strict=True)):
        run_seed, draw_seed = own.spawn(2)

        def share_done(share: float, done: int = done) -> None:
            on_progress((done + share) / len(readings))

        sample = calibrate(reading.space, partial(_factors, reading), effort, run_seed, share_done)
        values = reading.space.values(sample.u)
        draws = standard_normal_draws(PREDICTION_RELEASES, draw_seed)[BLOCK]
        outcome = probabilistic_outcome(table_3(values, reading.momentum_factor), BLOCK, draws)
        found["percent"].append(100.0 * outcome.frequencies)
        found["p"].append(np.array([summary.predictive_p(int(n), outcome, i) for i, n in enumerate(paper)]))
        for name in ("facing_deg", "line_tilt_deg"):
            found[name].append(values[name])
    return {name: np.stack(each) for name, each in found.items()}


def _factors(reading: Reading, draws: Draws) -> list[Factor]:
    def simulate(values: Values, block: str, own: Array) -> Outcome:
        return probabilistic_outcome(table_3(values, reading.momentum_factor), block, own)

    model = Model(simulate, lambda *of: simulate(*of).crossed, reading.space)
    return [first_impacts_factor(model, BLOCK, draws), cells_factor(model, BLOCK, draws, published.PROBABILISTIC)]


def readings_table(found: Mapping[str, Array], readings: Sequence[Reading] = READINGS) -> pd.DataFrame:
    """One row for each reading: its ranges, the 95 % intervals of the posterior, the mean percentages that pass, and
    the lines whose number in the paper the posterior excludes (p < 0.05)."""
    rows = []
    for i, reading in enumerate(readings):
        row: dict[str, object] = {"reading": reading.name, "momentum_factor": reading.momentum_factor}
        for name in ("facing_deg", "line_tilt_deg"):
            low, high = getattr(reading, name)
            low95, high95 = np.percentile(found[name][i], [2.5, 97.5])
            row |= {f"{name}_from": low, f"{name}_to": high, f"{name}_low95": low95, f"{name}_high95": high95}
        mean = dict(zip(published.LINES, found["percent"][i].mean(axis=0).tolist(), strict=True))
        excluded = [line for line, p in zip(published.LINES, found["p"][i], strict=True) if p < SIGNIFICANT]
        rows.append({**row, **mean, "excluded": ", ".join(excluded) or "none"})
    return pd.DataFrame(rows)
