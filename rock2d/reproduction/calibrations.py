"""The calibrations and their posteriors.

Both models are calibrated on the sphere's cells of Table 2 and on the statements on first impacts; each slope reduction
on the cells of its block; the deterministic model with candidate effects on the cells of two blocks. The calibrations
are modular as in the paper: the rows of the cube and the parallelepiped do not influence the parameters of the sphere,
and only these rows determine the slope reductions (a cut posterior, Plummer 2015). Statements and cells count the same
50 releases; their likelihoods are multiplied as if they were independent (assumption)."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.special import ndtri

from rock2d.arrays import Array
from rock2d.calibration.sequential_monte_carlo import Factor, Moves, Quantity, Sample, Space, posterior, prior_draws
from rock2d.reproduction import published
from rock2d.reproduction.hypotheses import DETERMINISTIC_SPACE, PROBABILISTIC_SPACE, SETUP_QUANTITIES, Values, table_4
from rock2d.reproduction.likelihood import (
    first_impact_log_likelihood,
    highest_log_counts,
    log_counts,
    passing_log_likelihood,
)
from rock2d.reproduction.outcomes import (
    Outcome,
    WorldChange,
    by_last_line,
    deterministic_crossed,
    deterministic_first_impacts,
    deterministic_outcome,
    probabilistic_outcome,
)
from rock2d.scene.world import World

Draws = Mapping[str, Array]  # block -> (releases, 6) standard normal draws
OnProgress = Callable[[float], None]

# the sampler uses this share of the releases up to this power of the likelihood, where their noise matters little
COARSE_SHARE, COARSE_UP_TO = 0.25, 0.1
WORK_EXPONENT = 0.4  # the finished part of a calibration is about (power of the likelihood) ** WORK_EXPONENT
NO_CANDIDATE = "none"
# effects of the catalogue that change an impact and depend neither on the camera nor on the order of the releases
CANDIDATES = (
    NO_CANDIDATE, "adhesion", "embankment_yield", "out_of_plane", "ploughing_drag", "rounded_edges", "viscous_damping",
    "zone_contrast",
)  # fmt: skip
MOST_CANDIDATE_PARAMETERS = 3
CANDIDATE_SPACE = Space(
    (
        *DETERMINISTIC_SPACE.quantities,
        Quantity("candidate", 0.0, 1.0, source="none: 1/2; the others equally likely"),
        *(
            Quantity(f"candidate.{i}", 0.0, 1.0, source="the effect's own range")
            for i in range(MOST_CANDIDATE_PARAMETERS)
        ),
    )
)
SLOPE_REDUCTIONS_DEG = np.linspace(0.0, 60.0, 11)


@dataclass(frozen=True)
class Effort:
    """Size of the calibrations.

    Attributes
    ----------
    hypotheses : number in each posterior, a multiple of twice the moves; two independent runs give half of them each
    releases : number of releases of each block for each hypothesis; powers of 2 are spread most evenly
    moves : rounds of moves at each step of the sampler
    prior_draws : draws from the prior for each hypothesis"""

    hypotheses: int = 384
    releases: int = 64
    moves: int = 3
    prior_draws: int = 4


@dataclass(frozen=True)
class Model:
    """A model to calibrate.

    Attributes
    ----------
    first_impacts : simulates the first impacts of a block for hypotheses of `space`; they do not depend on the law
    crossed : simulates (k, n, lines) whether these releases pass each line
    space : the unknowns"""

    first_impacts: Callable[[Values, str, Array], Outcome]
    crossed: Callable[[Values, str, Array], Array]
    space: Space


DETERMINISTIC_MODEL = Model(deterministic_first_impacts, deterministic_crossed, DETERMINISTIC_SPACE)


def calibrate(
    space: Space, factors: Callable[[Draws], list[Factor]], effort: Effort, seed: np.random.SeedSequence,
    on_progress: OnProgress, redrawn: Array | None = None,
) -> Sample:  # fmt: skip
    """The posterior over a space. `factors` gives the factors of the likelihood for standard normal draws.

    Half of the hypotheses come from one run of the sampler, half from a second run with other releases. Each run begins
    with COARSE_SHARE of the releases."""
    width, half = len(space.quantities), effort.hypotheses // 2
    moves = Moves(effort.moves, redrawn=redrawn, groups=_move_groups(space, redrawn), every_round=True)
    runs: list[Sample] = []
    for own in seed.spawn(2):
        draws = standard_normal_draws(effort.releases, own)
        few = {block: d[: max(1, round(COARSE_SHARE * effort.releases))] for block, d in draws.items()}
        rng = np.random.default_rng(own.spawn(1)[0])

        def report_progress(power: float) -> None:
            on_progress((len(runs) + power**WORK_EXPONENT) / 2)

        prior = prior_draws(effort.prior_draws * half, width, rng)
        finer = COARSE_UP_TO, factors(draws)
        runs.append(posterior(factors(few), prior, half, rng, moves, finer=finer, on_progress=report_progress))
    return Sample.joined(runs)


def setup_columns(space: Space) -> Array:
    """Columns of the unknowns of the set-up."""
    return space.columns([q.name for q in SETUP_QUANTITIES])


def arrival_columns(space: Space, block: str) -> Array:
    """Columns of the unknowns of a block's arrival; none if the space does not contain the block."""
    return space.columns([q.name for q in space.quantities if q.name.startswith(f"{block}.")])


def law_columns(space: Space) -> Array:
    """Columns of all other unknowns: the parameters of the law, and the candidate."""
    others = [setup_columns(space), *(arrival_columns(space, block) for block in published.BLOCKS)]
    return np.setdiff1d(np.arange(len(space.quantities)), np.concatenate(others))


def candidate_columns(space: Space) -> Array:
    """Columns of the choice of a candidate and of its sizes."""
    return space.columns([q.name for q in space.quantities if q.name.startswith("candidate")])


def _move_groups(space: Space, redrawn: Array | None) -> list[Array]:
    """Columns that are moved together: the arrival of a block changes few factors, the set-up all."""
    arrivals = [arrival_columns(space, block) for block in published.BLOCKS]
    law = np.setdiff1d(law_columns(space), [] if redrawn is None else redrawn)
    return [group for group in (setup_columns(space), *arrivals, law) if len(group)]


def first_impacts_factor(model: Model, block: str, draws: Draws) -> Factor:
    """The likelihood of the statements on the first impacts of a block."""

    def log_likelihood(u: Array) -> Array:
        outcome = model.first_impacts(model.space.values(u), block, draws[block])
        return first_impact_log_likelihood(outcome, block)

    own = setup_columns(model.space), arrival_columns(model.space, block), candidate_columns(model.space)
    return Factor(log_likelihood, np.concatenate(own), highest=0.0)


def cells_factor(model: Model, block: str, draws: Draws, percent: Array | None = None) -> Factor:
    """The likelihood of the cells of a block in a table `percent` (blocks, lines) of Table 2; default: the experiment.

    For hypotheses that the first impacts do not exclude."""
    counts = published.counts_by_last_line(published.EXPERIMENT if percent is None else percent, block)

    def log_likelihood(u: Array) -> Array:
        return log_counts(by_last_line(model.crossed(model.space.values(u), block, draws[block])), counts)

    own = setup_columns(model.space), arrival_columns(model.space, block), law_columns(model.space)
    return Factor(log_likelihood, np.concatenate(own), highest_log_counts(counts))


def _factors(model: Model, blocks_with_cells: Sequence[str]) -> Callable[[Draws], list[Factor]]:
    """The factors of the first impacts of all blocks and of the cells of `blocks_with_cells`."""
    return lambda draws: [
        *(first_impacts_factor(model, block, draws) for block in published.BLOCKS),
        *(cells_factor(model, block, draws) for block in blocks_with_cells),
    ]


def calibrate_deterministic(effort: Effort, seed: np.random.SeedSequence, on_progress: OnProgress) -> Sample:
    """Calibrate the deterministic model on the sphere's cells: DETERMINISTIC_SPACE."""
    factors = _factors(DETERMINISTIC_MODEL, ["sphere"])
    return calibrate(DETERMINISTIC_SPACE, factors, effort, seed, on_progress)


def calibrate_probabilistic(effort: Effort, seed: np.random.SeedSequence, on_progress: OnProgress) -> Sample:
    """Calibrate the probabilistic model on the sphere's cells: PROBABILISTIC_SPACE.

    Its posterior has several modes; twice as many hypotheses find them all."""
    effort = replace(effort, hypotheses=2 * effort.hypotheses, prior_draws=2 * effort.prior_draws)
    model = Model(probabilistic_outcome, lambda *of: probabilistic_outcome(*of).crossed, PROBABILISTIC_SPACE)
    return calibrate(PROBABILISTIC_SPACE, _factors(model, ["sphere"]), effort, seed, on_progress)


def calibrate_candidates(
    held_out: str, effort: Effort, seed: np.random.SeedSequence, on_progress: OnProgress
) -> Sample:
    """Calibrate the deterministic model with at most one candidate effect on the cells of the other blocks:
    CANDIDATE_SPACE."""
    others = [block for block in published.BLOCKS if block != held_out]
    model = Model(
        _with_candidates(deterministic_first_impacts), _with_candidates(deterministic_crossed), CANDIDATE_SPACE
    )
    choice = candidate_columns(CANDIDATE_SPACE)
    return calibrate(CANDIDATE_SPACE, _factors(model, others), effort, seed, on_progress, redrawn=choice)


def calibrate_with_arrivals(effort: Effort, seed: np.random.SeedSequence, on_progress: OnProgress) -> Sample:
    """Calibrate the deterministic model on the paper's deterministic column, the statements on first impacts and the
    sphere's experimental row: DETERMINISTIC_SPACE.

    The paper's simulations started from the measured arrivals with the parameters of Table 4; Table 2 gives their
    passing frequencies. These columns therefore inform about the set-up and the arrivals, but not about the passing
    frequencies of the experiment. Here set-up and arrivals explain the paper's deterministic column under Table 4. In
    another factor of the likelihood the parameters of the law are free, and explain the experimental row of the sphere
    from the same arrivals. Assumption: the 50 simulated and the 50 filmed releases of a block are independent draws of
    one distribution."""
    return calibrate(DETERMINISTIC_SPACE, arrival_factors, effort, seed, on_progress)


def arrival_factors(draws: Draws) -> list[Factor]:
    """The statements on first impacts, the paper's deterministic column under Table 4, and the sphere's experimental
    row."""
    with_table_4 = replace(DETERMINISTIC_MODEL, crossed=lambda values, *of: deterministic_crossed(table_4(values), *of))
    laws = law_columns(DETERMINISTIC_SPACE)

    def of_paper(block: str) -> Factor:
        own = cells_factor(with_table_4, block, draws, published.DETERMINISTIC)
        return replace(own, columns=np.setdiff1d(own.columns, laws))

    return [
        *(first_impacts_factor(DETERMINISTIC_MODEL, block, draws) for block in published.BLOCKS),
        *(of_paper(block) for block in published.BLOCKS),
        cells_factor(DETERMINISTIC_MODEL, "sphere", draws),
    ]


def calibrate_slope_reductions(
    sample: Array, effort: Effort, seed: np.random.SeedSequence, on_progress: OnProgress
) -> dict[str, Array]:
    """block -> (k,) slope reduction in degrees for each hypothesis `sample` (k, d) of PROBABILISTIC_SPACE.

    It is drawn from its posterior given the cells of the block, separately for each hypothesis: these cells do not
    influence set-up, incident states and the parameters of the sphere."""
    draw_seed, run_seed = seed.spawn(2)
    draws, rng = standard_normal_draws(effort.releases, draw_seed), np.random.default_rng(run_seed)
    values = PROBABILISTIC_SPACE.values(sample)
    found = {"sphere": np.zeros(len(sample))}
    for b, block in enumerate(published.BLOCKS[1:]):
        table = np.empty((len(sample), len(SLOPE_REDUCTIONS_DEG)))
        for i, alpha in enumerate(SLOPE_REDUCTIONS_DEG):
            outcome = probabilistic_outcome(values, block, draws[block], np.full(len(sample), alpha))
            table[:, i] = passing_log_likelihood(outcome, block)
            on_progress((b + (i + 1) / len(SLOPE_REDUCTIONS_DEG)) / 2)
        weight = np.exp(table - table.max(axis=1, keepdims=True))
        share = np.cumsum(weight, axis=1) / weight.sum(axis=1, keepdims=True)
        found[block] = SLOPE_REDUCTIONS_DEG[(rng.random(len(sample))[:, None] > share).sum(axis=1)]
    return found


def candidate_indices(values: Values) -> Array:
    """(n,) indices into CANDIDATES of hypotheses of CANDIDATE_SPACE; "none" has the prior probability 1/2."""
    drawn, others = values["candidate"], len(CANDIDATES) - 1
    return np.where(drawn < 0.5, 0, 1 + np.minimum((2.0 * drawn - 1.0) * others, others - 1).astype(int))


def candidate_prior(candidate: str) -> float:
    """Prior probability of a candidate."""
    return 0.5 if candidate == NO_CANDIDATE else 0.5 / (len(CANDIDATES) - 1)


def candidate_value(candidate: str) -> float:
    """The value of the unknown `candidate` that chooses a candidate: the inverse of `candidate_indices`."""
    place = CANDIDATES.index(candidate)
    return 0.25 if place == 0 else 0.5 + 0.5 * (place - 0.5) / (len(CANDIDATES) - 1)


def _with_candidates(simulate: Callable[..., Any]) -> Callable[[Values, str, Array], Any]:
    """A simulation of the deterministic model with the candidate effects of hypotheses of CANDIDATE_SPACE."""
    return lambda values, block, draws: simulate(values, block, draws, _candidate_change(values))


candidate_outcome: Callable[[Values, str, Array], Outcome] = _with_candidates(deterministic_outcome)


def _candidate_change(values: Values) -> WorldChange:
    """The change of the world of each hypothesis by its candidate effect; sizes whose range is positive are distributed
    on a logarithmic scale."""
    from rock2d.effects import catalogue

    effects = catalogue()
    which = candidate_indices(values)

    def change(world: World, i: int) -> World:
        name = CANDIDATES[which[i]]
        if name == NO_CANDIDATE:
            return world
        effect, sizes = effects[name], []
        for k, parameter in enumerate(effect.parameters):
            if parameter.has_neutral_choice:
                sizes.append(parameter.neutral)
                continue
            own = parameter.at(world.mean_size_m, world.gravity_m_s2)
            drawn = Quantity(own.name, own.low, own.high, log=own.low > 0)
            sizes.append(float(drawn.value(values[f"candidate.{k}"][i])))
        return effect.apply(world, sizes)

    return change


def standard_normal_draws(releases: int, seed: np.random.SeedSequence) -> dict[str, Array]:
    """block -> (releases, 6) standard normal draws from a Sobol sequence. All hypotheses share them, so that the
    likelihood is a deterministic function."""
    seeds = zip(published.BLOCKS, seed.spawn(len(published.BLOCKS)), strict=True)
    even = {name: prior_draws(releases, 6, np.random.default_rng(own)) for name, own in seeds}
    # without the factor, 0 and 1 would give infinite values
    return {name: ndtri(0.5 + (1.0 - 1e-9) * (u - 0.5)) for name, u in even.items()}
