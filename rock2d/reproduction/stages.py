"""The calibrations, each a posterior: on the sphere and the words, on all cells with candidate physics, and of the
probabilistic model.

Modular where the paper is: what is calibrated on the sphere learns nothing from the cube's and the parallelepiped's
rows of Table 2; their slope reductions learn from them alone (a cut posterior, Plummer 2015).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rock2d.calibration import Quantity, Sample, Space, posterior, prior_draws
from rock2d.reproduction import published
from rock2d.reproduction.evidence import log_lines, log_words
from rock2d.reproduction.hypotheses import FULL_SPACE, REBOUND, Values, names
from rock2d.reproduction.passing import Change, Known, Outcome, bounce, fall
from rock2d.world import World

Array = np.ndarray
Told = Callable[[float], None]

PRIOR_SHARE = 4  # draws of the prior for each hypothesis of the posterior
NONE = "none"
CANDIDATES = (
    NONE, "adhesion", "embankment_yield", "out_of_plane", "ploughing_drag", "rounded_edges", "viscous_damping",
    "zone_contrast",
)  # fmt: skip
MOST_PARAMETERS = 3
CANDIDATE_SPACE = Space(
    (
        *FULL_SPACE.quantities,
        Quantity("candidate", 0.0, 1.0, source="none: 1/2; the others alike"),
        *(
            Quantity(f"candidate.{i}", 0.0, 1.0, source="the effect's own range")
            for i in range(MOST_PARAMETERS)
        ),
    )
)
PROBABILISTIC_SPACE = Space((*FULL_SPACE.quantities, *REBOUND))
REDUCTIONS_DEG = np.linspace(0.0, 60.0, 11)


@dataclass(frozen=True)
class Effort:
    """Hypotheses of each posterior, and releases of each block that a hypothesis is judged by."""

    hypotheses: int = 384
    releases: int = 40


def draws_of(effort: Effort, seed: np.random.SeedSequence) -> dict[str, Array]:
    """block -> (releases, 6) standard normal draws, the same for every hypothesis: the likelihood is a function."""
    return {
        name: np.random.default_rng(child).standard_normal((effort.releases, 6))
        for name, child in zip(published.BLOCKS, seed.spawn(len(published.BLOCKS)), strict=True)
    }


def calibrate(known: Known, effort: Effort, seed: np.random.SeedSequence, told: Told) -> Sample:
    """The deterministic model, calibrated on the sphere's cells and the words on first impacts: FULL_SPACE."""
    draw_seed, run_seed = seed.spawn(2)
    draws = draws_of(effort, draw_seed)

    def likelihood(u: Array) -> Array:
        values = FULL_SPACE.values(u)
        return _sum_where_possible(
            len(u),
            [_term(fall, known, values, block, draws, block == "sphere") for block in published.BLOCKS],
        )

    rng = np.random.default_rng(run_seed)
    start = prior_draws(PRIOR_SHARE * effort.hypotheses, len(FULL_SPACE.quantities), rng)
    return posterior(likelihood, start, effort.hypotheses, rng, told=told)


def try_candidates(
    known: Known, left_out: str, effort: Effort, seed: np.random.SeedSequence, told: Told
) -> Sample:
    """The deterministic model with one candidate effect or none: CANDIDATE_SPACE, on the words and on the cells of all
    blocks but the one `left_out`."""
    draw_seed, run_seed = seed.spawn(2)
    draws = draws_of(effort, draw_seed)

    def likelihood(u: Array) -> Array:
        values = CANDIDATE_SPACE.values(u)
        terms = [
            _term(fall_with_candidate, known, values, block, draws, block != left_out)
            for block in published.BLOCKS
        ]
        return _sum_where_possible(len(u), terms)

    rng = np.random.default_rng(run_seed)
    width = len(CANDIDATE_SPACE.quantities)
    start = prior_draws(PRIOR_SHARE * effort.hypotheses, width, rng)
    redrawn = np.arange(len(FULL_SPACE.quantities), width)
    return posterior(likelihood, start, effort.hypotheses, rng, redrawn=redrawn, told=told)


def calibrate_rebound(
    known: Known, benches: Array, effort: Effort, seed: np.random.SeedSequence, told: Told
) -> Sample:
    """The probabilistic model on the sphere, on the benches that the deterministic calibration left possible
    (hypotheses of FULL_SPACE, `benches`): PROBABILISTIC_SPACE."""
    draw_seed, run_seed = seed.spawn(2)
    draws = draws_of(effort, draw_seed)

    def likelihood(u: Array) -> Array:
        return _term(bounce, known, PROBABILISTIC_SPACE.values(u), "sphere", draws, True)(
            np.ones(len(u), bool)
        )

    rng = np.random.default_rng(run_seed)
    free = PROBABILISTIC_SPACE.columns(names(REBOUND))
    start = np.hstack(
        [np.repeat(benches, PRIOR_SHARE, axis=0), prior_draws(PRIOR_SHARE * len(benches), len(free), rng)]
    )
    return posterior(likelihood, start, effort.hypotheses, rng, free=free, told=told)


def reduce_slopes(
    known: Known, sample: Array, effort: Effort, seed: np.random.SeedSequence, told: Told
) -> dict[str, Array]:
    """block -> (k,) α in degrees for each hypothesis of PROBABILISTIC_SPACE, drawn from its posterior given the block's
    own cells, hypothesis by hypothesis: bench, starts and the sphere's parameters learn nothing from them."""
    draw_seed, run_seed = seed.spawn(2)
    draws, rng = draws_of(effort, draw_seed), np.random.default_rng(run_seed)
    values = PROBABILISTIC_SPACE.values(sample)
    found = {"sphere": np.zeros(len(sample))}
    for b, block in enumerate(published.BLOCKS[1:]):
        table = np.empty((len(sample), len(REDUCTIONS_DEG)))
        for i, alpha in enumerate(REDUCTIONS_DEG):
            outcome = bounce(known, values, block, draws[block], np.full(len(sample), alpha))
            table[:, i] = log_lines(outcome, block)
            told((b + (i + 1) / len(REDUCTIONS_DEG)) / 2)
        weight = np.exp(table - table.max(axis=1, keepdims=True))
        share = np.cumsum(weight, axis=1) / weight.sum(axis=1, keepdims=True)
        found[block] = REDUCTIONS_DEG[(rng.random(len(sample))[:, None] > share).sum(axis=1)]
    return found


def candidate_of(values: Values) -> Array:
    """(n,) indices into CANDIDATES of hypotheses of CANDIDATE_SPACE: half of the prior is none."""
    drawn, others = values["candidate"], len(CANDIDATES) - 1
    return np.where(drawn < 0.5, 0, 1 + np.minimum((2.0 * drawn - 1.0) * others, others - 1).astype(int))


def fall_with_candidate(known: Known, values: Values, block: str, draws: Array) -> Outcome:
    """`passing.fall` with the candidate effects of hypotheses of CANDIDATE_SPACE."""
    return fall(known, values, block, draws, _with_candidate(values))


def _with_candidate(values: Values) -> Change:
    """What the candidate of a hypothesis does to its world."""
    from rock2d.effects import catalogue

    effects = catalogue()
    which = candidate_of(values)

    def change(world: World, i: int) -> World:
        name = CANDIDATES[which[i]]
        if name == NONE:
            return world
        effect = effects[name]
        parameters = [p.at(world.mean_size_m, world.gravity_m_s2) for p in effect.parameters]
        shares = [values[f"candidate.{k}"][i] for k in range(len(parameters))]
        sizes = [p.low + (p.high - p.low) * s for p, s in zip(parameters, shares, strict=True)]
        return effect.apply(world, sizes)

    return change


def _term(
    model: Callable[..., Outcome],
    known: Known,
    values: Values,
    block: str,
    draws: dict[str, Array],
    lines: bool,
) -> Callable[[Array], Array]:
    """The log-likelihood of a block's words, and of its lines, as a function of which hypotheses are asked."""

    def term(asked: Array) -> Array:
        total = np.full(len(asked), -np.inf)
        if asked.any():
            own = {key: v[asked] for key, v in values.items()}
            outcome = model(known, own, block, draws[block])
            total[asked] = log_words(outcome, block) + (log_lines(outcome, block) if lines else 0.0)
        return total

    return term


def _sum_where_possible(count: int, terms: list[Callable[[Array], Array]]) -> Array:
    """The sum of the terms, each asked only of hypotheses that those before it left possible."""
    total = np.zeros(count)
    for term in terms:
        total = total + term(np.isfinite(total))
    return total
