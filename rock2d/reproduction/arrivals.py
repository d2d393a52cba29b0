"""Arrivals of the blocks, from the paper's own simulations.

The paper's simulations started from the measured arrivals, with the parameters of Table 4, and their passing
frequencies are printed in Table 2. So these columns tell about the set-up and the arrivals, and they hold nothing of
the experiment's passing frequencies. Here set-up and arrivals explain the paper's deterministic column under Table 4;
the parameters of the law, free in another factor of the likelihood, explain the sphere's experimental row from the same
arrivals.

Assumed: the paper's 50 simulated and the 50 filmed releases of a block are independent draws of one distribution.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rock2d.calibration.sequential_monte_carlo import Factor, Moves, Sample, posterior, prior_draws
from rock2d.reproduction import published
from rock2d.reproduction.hypotheses import (
    CONTACT_QUANTITIES,
    DETERMINISTIC_SPACE,
    SETUP_QUANTITIES,
    KnownSetup,
    Values,
    arrival_quantities,
)
from rock2d.reproduction.likelihood import (
    first_impact_log_likelihood,
    passing_log_likelihood,
    published_log_likelihood,
)
from rock2d.reproduction.outcomes import deterministic_outcome
from rock2d.reproduction.stages import (
    PRIOR_DRAWS_PER_HYPOTHESIS,
    Effort,
    OnProgress,
    standard_normal_draws,
)

Array = np.ndarray

# Of the effort of the other calibrations: moves in groups change more at once, and each costs several simulations.
ROUNDS_OVER_MOVES = 1 / 6
SHARE_OF_HYPOTHESES, SHARE_OF_RELEASES = 0.3, 0.6


def table_4(values: Values) -> dict[str, Array]:
    """Hypotheses with the parameters of Table 4 instead of their own."""
    ones, paper = np.ones(len(values["slope_deg"])), published.CONTACT_PARAMETERS
    own = {name: value * ones for name, value in paper.items() if name != "k_ul_N_m"}
    return {**values, **own, "restitution": np.sqrt(paper["k_l_N_m"] / paper["k_ul_N_m"]) * ones}


def calibrate_with_arrivals(
    known: KnownSetup, effort: Effort, seed: np.random.SeedSequence, on_progress: OnProgress
) -> Sample:
    """The deterministic model given the paper's deterministic column, the statements on first impacts and the sphere's
    experimental row: DETERMINISTIC_SPACE. Half of the hypotheses come from one run of the sampler, half from another
    with other releases."""
    half, runs = round(SHARE_OF_HYPOTHESES * effort.hypotheses / 2), list[Sample]()
    moves = Moves(max(1, round(ROUNDS_OVER_MOVES * effort.moves)), groups=_groups())
    for own in seed.spawn(2):
        draws = standard_normal_draws(max(1, round(SHARE_OF_RELEASES * effort.releases)), own)
        rng = np.random.default_rng(own.spawn(1)[0])

        def halfway(power: float) -> None:
            on_progress((len(runs) + power) / 2)

        prior = prior_draws(PRIOR_DRAWS_PER_HYPOTHESIS * half, len(DETERMINISTIC_SPACE.quantities), rng)
        runs.append(posterior(_factors(known, draws), prior, half, rng, moves, on_progress=halfway))
    return Sample.joined(runs)


def _columns(*quantities: str) -> Array:
    return DETERMINISTIC_SPACE.columns(quantities)


def _of_setup() -> Array:
    return _columns(*(q.name for q in SETUP_QUANTITIES))


def _of_contact() -> Array:
    return _columns(*(q.name for q in CONTACT_QUANTITIES))


def _of_arrival(block: str) -> Array:
    return _columns(*(q.name for q in arrival_quantities(block)))


def _groups() -> list[Array]:
    """The arrival of a block touches one factor or two, the set-up all; so arrivals and law move twice in a round."""
    arrivals = [_of_arrival(block) for block in published.BLOCKS]
    return [_of_setup(), *arrivals, _of_contact(), *arrivals, _of_contact()]


def _factors(known: KnownSetup, draws: dict[str, Array]) -> list[Factor]:
    """One factor for each block's row of the paper's deterministic column, and the sphere's experimental row."""

    def of_paper(block: str) -> Callable[[Array], Array]:
        def log_likelihood(u: Array) -> Array:
            values = table_4(DETERMINISTIC_SPACE.values(u))
            outcome = deterministic_outcome(known, values, block, draws[block])
            counts = published_log_likelihood(outcome, published.DETERMINISTIC, block)
            return first_impact_log_likelihood(outcome, block) + counts

        return log_likelihood

    def of_experiment(u: Array) -> Array:
        values = DETERMINISTIC_SPACE.values(u)
        return passing_log_likelihood(
            deterministic_outcome(known, values, "sphere", draws["sphere"]), "sphere"
        )

    setup = _of_setup()
    factors = [Factor(of_paper(b), np.concatenate([setup, _of_arrival(b)])) for b in published.BLOCKS]
    of_law = np.concatenate([setup, _of_arrival("sphere"), _of_contact()])
    return [*factors, Factor(of_experiment, of_law)]
