"""The calibrations, each a posterior: of both models on the sphere and the words, of the slope reductions on their own
block, and of the deterministic model with candidate physics.

Modular where the paper is: what is calibrated on the sphere learns nothing from the cube's and the parallelepiped's
rows of Table 2; the slope reductions learn from them alone (a cut posterior, Plummer 2015). Words and cells are counts
of the same 50 releases; their likelihoods are multiplied as if of different ones (assumed).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from rock2d.calibration.sequential_monte_carlo import Quantity, Sample, Space, posterior, prior_draws
from rock2d.reproduction import published
from rock2d.reproduction.hypotheses import DETERMINISTIC_SPACE, PROBABILISTIC_SPACE, Values
from rock2d.reproduction.likelihood import log_lines, log_words
from rock2d.reproduction.passing import Change, Known, Outcome, bounce, fall, land
from rock2d.scene.world import World

Array = np.ndarray
OnProgress = Callable[[float], None]
Simulated = Callable[[Known, Values, str, Array], Outcome]

PRIOR_SHARE = 4  # draws of the prior for each hypothesis of the posterior
NONE = "none"
# the effects of the catalogue that change an impact and need no camera, no order and no scatter
CANDIDATES = (
    NONE, "adhesion", "embankment_yield", "out_of_plane", "ploughing_drag", "rounded_edges", "viscous_damping",
    "zone_contrast",
)  # fmt: skip
MOST_PARAMETERS = 3
CANDIDATE_SPACE = Space(
    (
        *DETERMINISTIC_SPACE.quantities,
        Quantity("candidate", 0.0, 1.0, source="none: 1/2; the others alike"),
        *(
            Quantity(f"candidate.{i}", 0.0, 1.0, source="the effect's own range")
            for i in range(MOST_PARAMETERS)
        ),
    )
)
REDUCTIONS_DEG = np.linspace(0.0, 60.0, 11)


@dataclass(frozen=True)
class Effort:
    """Hypotheses of each posterior (half of each of two independent runs), releases of each block that a hypothesis is
    judged by, and moves of all hypotheses at each step of the sampler."""

    hypotheses: int = 448
    releases: int = 40
    moves: int = 12


def calibrate(
    known: Known,
    simulated: Simulated,
    landed: Simulated,
    space: Space,
    cells_of: Sequence[str],
    effort: Effort,
    seed: np.random.SeedSequence,
    on_progress: OnProgress,
) -> Sample:
    """A model on the words of all blocks and on the cells of the blocks `cells_of`: hypotheses of `space`, half of them
    of one run of the sampler and half of another, with other releases, too.

    `simulated` and `landed`: the model, and for the other blocks the model up to their first impact.
    """
    width, half = len(space.quantities), effort.hypotheses // 2
    chosen = np.arange(len(DETERMINISTIC_SPACE.quantities), width) if space is CANDIDATE_SPACE else None
    runs: list[Sample] = []
    for own in seed.spawn(2):
        likelihood = _likelihood(simulated, landed, known, space, cells_of, effort, own)
        rng = np.random.default_rng(own.spawn(1)[0])

        def halfway(power: float) -> None:
            on_progress((len(runs) + power) / 2)

        start = prior_draws(PRIOR_SHARE * half, width, rng)
        runs.append(
            posterior(likelihood, start, half, rng, redrawn=chosen, moves=effort.moves, on_progress=halfway)
        )
    return Sample(
        np.concatenate([run.u for run in runs]),
        np.concatenate([run.log_likelihood for run in runs]),
        float(np.mean([run.log_evidence for run in runs])),
    )


def _likelihood(
    simulated: Simulated, landed: Simulated, known: Known, space: Space, cells_of: Sequence[str], effort: Effort,
    seed: np.random.SeedSequence,
) -> Callable[[Array], Array]:  # fmt: skip
    draws = draws_of(effort.releases, seed)

    def likelihood(u: Array) -> Array:
        values, total = space.values(u), np.zeros(len(u))
        for block in published.BLOCKS:  # each asked only of what those before it left possible
            asked = np.isfinite(total)
            if asked.any():
                own = {key: v[asked] for key, v in values.items()}
                model = simulated if block in cells_of else landed
                outcome = model(known, own, block, draws[block])
                total[asked] += log_words(outcome, block)
                if block in cells_of:
                    total[asked] += log_lines(outcome, block)
        return total

    return likelihood


def calibrate_deterministic(
    known: Known, effort: Effort, seed: np.random.SeedSequence, on_progress: OnProgress
) -> Sample:
    """The deterministic model on the sphere's cells: DETERMINISTIC_SPACE."""
    return calibrate(known, fall, land, DETERMINISTIC_SPACE, ("sphere",), effort, seed, on_progress)


def calibrate_probabilistic(
    known: Known, effort: Effort, seed: np.random.SeedSequence, on_progress: OnProgress
) -> Sample:
    """The probabilistic model on the sphere's cells: PROBABILISTIC_SPACE."""
    return calibrate(known, bounce, bounce, PROBABILISTIC_SPACE, ("sphere",), effort, seed, on_progress)


def try_candidates(
    known: Known, left_out: str, effort: Effort, seed: np.random.SeedSequence, on_progress: OnProgress
) -> Sample:
    """The deterministic model with one candidate effect or none, on the cells of the other blocks: CANDIDATE_SPACE."""
    others = [block for block in published.BLOCKS if block != left_out]
    models = fall_with_candidate, land_with_candidate
    return calibrate(known, *models, CANDIDATE_SPACE, others, effort, seed, on_progress)


def reduce_slopes(
    known: Known, sample: Array, effort: Effort, seed: np.random.SeedSequence, on_progress: OnProgress
) -> dict[str, Array]:
    """block -> (k,) α in degrees for each hypothesis of PROBABILISTIC_SPACE, drawn from its posterior given the block's
    own cells, hypothesis by hypothesis: set-up, starts and the sphere's parameters learn nothing from them."""
    draw_seed, run_seed = seed.spawn(2)
    draws, rng = draws_of(effort.releases, draw_seed), np.random.default_rng(run_seed)
    values = PROBABILISTIC_SPACE.values(sample)
    found = {"sphere": np.zeros(len(sample))}
    for b, block in enumerate(published.BLOCKS[1:]):
        table = np.empty((len(sample), len(REDUCTIONS_DEG)))
        for i, alpha in enumerate(REDUCTIONS_DEG):
            outcome = bounce(known, values, block, draws[block], np.full(len(sample), alpha))
            table[:, i] = log_lines(outcome, block)
            on_progress((b + (i + 1) / len(REDUCTIONS_DEG)) / 2)
        weight = np.exp(table - table.max(axis=1, keepdims=True))
        share = np.cumsum(weight, axis=1) / weight.sum(axis=1, keepdims=True)
        found[block] = REDUCTIONS_DEG[(rng.random(len(sample))[:, None] > share).sum(axis=1)]
    return found


def candidate_of(values: Values) -> Array:
    """(n,) indices into CANDIDATES of hypotheses of CANDIDATE_SPACE: half of the prior is none."""
    drawn, others = values["candidate"], len(CANDIDATES) - 1
    return np.where(drawn < 0.5, 0, 1 + np.minimum((2.0 * drawn - 1.0) * others, others - 1).astype(int))


def prior_of(candidate: str) -> float:
    """Prior probability of a candidate."""
    return 0.5 if candidate == NONE else 0.5 / (len(CANDIDATES) - 1)


def fall_with_candidate(known: Known, values: Values, block: str, draws: Array) -> Outcome:
    """`passing.fall` with the candidate effects of hypotheses of CANDIDATE_SPACE."""
    return fall(known, values, block, draws, _with_candidate(values))


def land_with_candidate(known: Known, values: Values, block: str, draws: Array) -> Outcome:
    """`passing.land` with the candidate effects of hypotheses of CANDIDATE_SPACE."""
    return land(known, values, block, draws, _with_candidate(values))


def _with_candidate(values: Values) -> Change:
    """What the candidate of a hypothesis does to its world; ratios are drawn on a logarithmic scale."""
    from rock2d.effects import catalogue

    effects = catalogue()
    which = candidate_of(values)

    def change(world: World, i: int) -> World:
        name = CANDIDATES[which[i]]
        if name == NONE:
            return world
        effect, sizes = effects[name], []
        for k, parameter in enumerate(effect.parameters):
            own = parameter.at(world.mean_size_m, world.gravity_m_s2)
            drawn = Quantity(own.name, own.low, own.high, log=own.low > 0)
            sizes.append(float(drawn.value(values[f"candidate.{k}"][i])))
        return effect.apply(world, sizes)

    return change


def draws_of(releases: int, seed: np.random.SeedSequence) -> dict[str, Array]:
    """block -> (releases, 6) standard normal draws, the same for every hypothesis: the likelihood is a function."""
    return {
        name: np.random.default_rng(child).standard_normal((releases, 6))
        for name, child in zip(published.BLOCKS, seed.spawn(len(published.BLOCKS)), strict=True)
    }
