"""Arrivals of the blocks, from the paper's own simulations.

The paper's simulations started from the measured arrivals, with the parameters of Table 4, and their passing
frequencies are printed in Table 2. So these columns tell about the set-up and the arrivals, and they hold nothing of
the experiment's passing frequencies. Here set-up and arrivals explain the paper's deterministic column under Table 4;
the parameters of the law, free in another factor of the likelihood, explain the sphere's experimental row from the same
arrivals.

Assumed: the paper's 50 simulated and the 50 filmed releases of a block are independent draws of one distribution.
"""

from __future__ import annotations

import numpy as np

from rock2d.calibration.sequential_monte_carlo import Factor, Sample
from rock2d.reproduction import published
from rock2d.reproduction.hypotheses import DETERMINISTIC_SPACE, KnownSetup, Values
from rock2d.reproduction.likelihood import (
    first_impact_log_likelihood,
    passing_log_likelihood,
    published_log_likelihood,
)
from rock2d.reproduction.outcomes import deterministic_outcome
from rock2d.reproduction.stages import (
    Draws,
    Effort,
    OnProgress,
    arrival_columns,
    calibrate,
    law_columns,
    setup_columns,
)

Array = np.ndarray

# Each round of moves costs several simulations with lines: shares of the effort of the other calibrations.
SHARE_OF_HYPOTHESES, SHARE_OF_RELEASES, SHARE_OF_MOVES = 0.4, 0.6, 1.0


def table_4(values: Values) -> dict[str, Array]:
    """Hypotheses with the parameters of Table 4 instead of their own."""
    ones, paper = np.ones(len(values["slope_deg"])), published.CONTACT_PARAMETERS
    own = {name: value * ones for name, value in paper.items() if name != "k_ul_N_m"}
    return {**values, **own, "restitution": np.sqrt(paper["k_l_N_m"] / paper["k_ul_N_m"]) * ones}


def calibrate_with_arrivals(
    known: KnownSetup, effort: Effort, seed: np.random.SeedSequence, on_progress: OnProgress
) -> Sample:
    """The deterministic model given the paper's deterministic column, the statements on first impacts and the sphere's
    experimental row: DETERMINISTIC_SPACE."""
    own = Effort(
        round(SHARE_OF_HYPOTHESES * effort.hypotheses),
        max(1, round(SHARE_OF_RELEASES * effort.releases)),
        max(1, round(SHARE_OF_MOVES * effort.moves)),
    )
    return calibrate(DETERMINISTIC_SPACE, lambda draws: factors(known, draws), own, seed, on_progress)


def factors(known: KnownSetup, draws: Draws) -> list[Factor]:
    """One factor for each block's row of the paper's deterministic column, and the sphere's experimental row."""
    space = DETERMINISTIC_SPACE
    setup = setup_columns(space)

    def of_paper(block: str) -> Factor:
        def log_likelihood(u: Array) -> Array:
            outcome = deterministic_outcome(known, table_4(space.values(u)), block, draws[block])
            counts = published_log_likelihood(outcome, published.DETERMINISTIC, block)
            return first_impact_log_likelihood(outcome, block) + counts

        return Factor(log_likelihood, np.concatenate([setup, arrival_columns(space, block)]))

    def of_experiment(u: Array) -> Array:
        outcome = deterministic_outcome(known, space.values(u), "sphere", draws["sphere"])
        return passing_log_likelihood(outcome, "sphere")

    own = np.concatenate([setup, arrival_columns(space, "sphere"), law_columns(space)])
    return [*(of_paper(block) for block in published.BLOCKS), Factor(of_experiment, own)]
