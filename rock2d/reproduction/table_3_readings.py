"""Readings of Table 3: under which of them does it give the sphere's row of the paper's probabilistic column?

The paper does not publish the facing's angle or how the measure lines lean, and its threshold M½ of the momentum may be
meant otherwise than here. Each reading bounds these; set-up and arrival are free within it and explain, with Table 3's
parameters, the sphere's first impacts and its passing frequencies. The sphere has no slope reduction, so nothing else
is open.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from rock2d.calibration.sequential_monte_carlo import Factor, Space
from rock2d.reproduction import published, summary
from rock2d.reproduction.hypotheses import (
    SETUP_QUANTITIES,
    KnownSetup,
    Values,
    arrival_quantities,
    table_3,
)
from rock2d.reproduction.outcomes import Outcome, probabilistic_outcome
from rock2d.reproduction.stages import (
    Draws,
    Effort,
    Model,
    OnProgress,
    calibrate,
    cells_factor,
    first_impacts_factor,
    standard_normal_draws,
)

if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray

BLOCK = "sphere"
SHARE_OF_HYPOTHESES = 0.5  # one block has few unknowns
PREDICTION_RELEASES = 128  # per hypothesis
SIGNIFICANT = 0.05


@dataclass(frozen=True)
class Reading:
    """Ranges of what Table 3 leaves open.

    Attributes
    ----------
    facing_deg : slope of the facing
    line_tilt_deg : tilt of the measure lines from upright
    momentum_factor : on both thresholds M½ of Table 3
    """

    name: str
    facing_deg: tuple[float, float]
    line_tilt_deg: tuple[float, float]
    momentum_factor: float = 1.0

    @property
    def space(self) -> Space:
        """Set-up and arrival within the reading."""
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


def readings_computed(
    known: KnownSetup,
    effort: Effort,
    seed: np.random.SeedSequence,
    on_progress: OnProgress,
    readings: Sequence[Reading] = READINGS,
) -> dict[str, Array]:
    """For each reading, of the hypotheses that explain the row best: `percent` (readings, k, lines) that pass, `p`
    (readings, lines) of the paper's numbers under them, `facing_deg` and `line_tilt_deg` (readings, k)."""
    effort = replace(effort, hypotheses=round(SHARE_OF_HYPOTHESES * effort.hypotheses))
    paper = published.passed(published.PROBABILISTIC)[published.BLOCKS.index(BLOCK)]
    found: dict[str, list[Array]] = {"percent": [], "p": [], "facing_deg": [], "line_tilt_deg": []}
    for done, (reading, own) in enumerate(zip(readings, seed.spawn(len(readings)), strict=True)):
        run_seed, draw_seed = own.spawn(2)

        def share_done(share: float, done: int = done) -> None:
            on_progress((done + share) / len(readings))

        sample = calibrate(reading.space, partial(_factors, reading, known), effort, run_seed, share_done)
        values = reading.space.values(sample.u)
        draws = standard_normal_draws(PREDICTION_RELEASES, draw_seed)[BLOCK]
        outcome = probabilistic_outcome(known, table_3(values, reading.momentum_factor), BLOCK, draws)
        found["percent"].append(100.0 * outcome.frequencies)
        found["p"].append(np.array([summary.predictive_p(int(n), outcome, i) for i, n in enumerate(paper)]))
        for name in ("facing_deg", "line_tilt_deg"):
            found[name].append(values[name])
    return {name: np.stack(each) for name, each in found.items()}


def _factors(reading: Reading, known: KnownSetup, draws: Draws) -> list[Factor]:
    def simulate(known: KnownSetup, values: Values, block: str, own: Array) -> Outcome:
        return probabilistic_outcome(known, table_3(values, reading.momentum_factor), block, own)

    model = Model(simulate, lambda *of: simulate(*of).crossed, reading.space)
    return [
        first_impacts_factor(known, model, BLOCK, draws),
        cells_factor(known, model, BLOCK, draws, published.PROBABILISTIC),
    ]


def readings_table(found: Mapping[str, Array], readings: Sequence[Reading] = READINGS) -> pd.DataFrame:
    """One row for each reading: what it bounds, the set-up found within it, the mean percentages that pass, and the
    lines whose number in the paper the hypotheses exclude (p < 0.05)."""
    import pandas as pd

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
