"""Arrivals of the blocks, inferred from the simulations of the paper.

The paper's simulations started from the measured arrivals with the parameters of Table 4; Table 2 gives their passing
frequencies. These columns therefore inform about the set-up and the arrivals, but not about the passing frequencies of
the experiment. Here set-up and arrivals explain the paper's deterministic column under Table 4. In another factor of
the likelihood the parameters of the law are free, and explain the experimental row of the sphere from the same
arrivals.

Assumption: the 50 simulated and the 50 filmed releases of a block are independent draws of one distribution.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rock2d.calibration.sequential_monte_carlo import Factor, Sample
from rock2d.reproduction import published
from rock2d.reproduction.hypotheses import DETERMINISTIC_SPACE, KnownSetup, table_4
from rock2d.reproduction.outcomes import deterministic_crossed
from rock2d.reproduction.stages import (
    DETERMINISTIC_MODEL,
    Draws,
    Effort,
    OnProgress,
    calibrate,
    cells_factor,
    first_impacts_factor,
    law_columns,
)


def calibrate_with_arrivals(
    known: KnownSetup, effort: Effort, seed: np.random.SeedSequence, on_progress: OnProgress
) -> Sample:
    """The deterministic model given the paper's deterministic column, the statements on first impacts and the sphere's
    experimental row: DETERMINISTIC_SPACE."""
    return calibrate(DETERMINISTIC_SPACE, lambda draws: factors(known, draws), effort, seed, on_progress)


def factors(known: KnownSetup, draws: Draws) -> list[Factor]:
    """The statements on first impacts, the paper's deterministic column under Table 4, and the sphere's experimental
    row."""
    with_table_4 = replace(
        DETERMINISTIC_MODEL,
        crossed=lambda known, values, *of: deterministic_crossed(known, table_4(values), *of),
    )
    laws = law_columns(DETERMINISTIC_SPACE)

    def of_paper(block: str) -> Factor:
        own = cells_factor(known, with_table_4, block, draws, published.DETERMINISTIC)
        return replace(own, columns=np.setdiff1d(own.columns, laws))

    return [
        *(first_impacts_factor(known, DETERMINISTIC_MODEL, block, draws) for block in published.BLOCKS),
        *(of_paper(block) for block in published.BLOCKS),
        cells_factor(known, DETERMINISTIC_MODEL, "sphere", draws),
    ]
