"""The effects that the paper's models lack: candidates are added to each model, with the arrivals inferred from the
paper's simulations.

The deterministic model keeps the parameters of Table 4, so that other parameters cannot compensate for a candidate. The
probabilistic model has parameters that explain the experimental row of the sphere, because those of Table 3 do not. A
candidate is calibrated on the experimental rows of some blocks and scored on the row of another: hypotheses and sizes
of the effect are drawn from their priors and weighted by the likelihood."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from rock2d.arrays import Array
from rock2d.calibration.sequential_monte_carlo import resampled
from rock2d.reproduction import published
from rock2d.reproduction.calibrations import (
    CANDIDATES,
    MOST_CANDIDATE_PARAMETERS,
    NO_CANDIDATE,
    Effort,
    OnProgress,
    candidate_outcome,
    candidate_value,
    standard_normal_draws,
)
from rock2d.reproduction.hypotheses import DETERMINISTIC_SPACE, REBOUND_QUANTITIES, Values, table_4
from rock2d.reproduction.likelihood import passing_log_likelihood
from rock2d.reproduction.outcomes import Outcome, probabilistic_outcome
from rock2d.scene.blocks import Block

# (values of hypotheses, block, draws, name of a candidate, (k, parameters) its sizes in [0, 1]) -> outcome
Simulation = Callable[[Values, str, Array, str, Array], Outcome]

HYPOTHESES, SIZES = 48, 4  # hypotheses of the posterior; sizes of a candidate for each hypothesis
REBOUND_DRAWS = 24  # parameter sets of the probabilistic model that are tried for each hypothesis
# held-out tests: the blocks on which a candidate is calibrated, and those on which it is scored
TESTS = ((("sphere",), ("cube", "parallelepiped")), (("cube",), ("parallelepiped",)), (("parallelepiped",), ("cube",)))
SHARE_OF_RELEASES = 0.6  # number of releases relative to the calibrations
RESAMPLES = 200  # bootstrap samples of the hypotheses, for the errors of scores

LARGEST_SLOPE_REDUCTION_DEG = 60.0  # for a square
SQUARE_OUT_OF_ROUND = np.sqrt(2.0) - 1.0  # R / r - 1
LARGEST_FRICTION_CHANGE_DEG = 30.0
SMALLEST_FACTOR = 0.2  # of a parameter of the probabilistic model
SLOPE_REDUCTION, SHAPE = "slope_reduction", "shape"
PROBABILISTIC_CANDIDATES = (NO_CANDIDATE, "friction", "momentum_half", "tangential_restitution", SLOPE_REDUCTION, SHAPE)


def deterministic_candidates(
    sample: Array, effort: Effort, seed: np.random.SeedSequence, on_progress: OnProgress
) -> dict[str, Array]:
    """Simulate the three blocks with Table 4 and each of CANDIDATES, for hypotheses `sample` (k', d) of
    DETERMINISTIC_SPACE.

    Returns `percent` (candidates, k, blocks, lines) that pass, and the `log_likelihood` (candidates, k, blocks) of the
    experimental rows."""

    def simulate(values: Values, block: str, draws: Array, candidate: str, sizes: Array) -> Outcome:
        own = {f"candidate.{i}": size for i, size in enumerate(sizes.T)}
        chosen = np.full(len(sizes), candidate_value(candidate))
        return candidate_outcome({**values, "candidate": chosen, **own}, block, draws)

    values = table_4(DETERMINISTIC_SPACE.values(_evenly_chosen(sample)))
    return _simulate_candidates(simulate, CANDIDATES, values, effort, seed, on_progress)


def probabilistic_candidates(
    sample: Array, effort: Effort, seed: np.random.SeedSequence, on_progress: OnProgress
) -> dict[str, Array]:
    """As `deterministic_candidates`, for PROBABILISTIC_CANDIDATES and parameters of the probabilistic model that
    explain the sphere."""
    fitting, trying = seed.spawn(2)
    fitted = _resampled_for_sphere(DETERMINISTIC_SPACE.values(_evenly_chosen(sample)), effort, fitting)

    def simulate(values: Values, block: str, draws: Array, candidate: str, sizes: Array) -> Outcome:
        changed, reduction = probabilistic_with(candidate, values, published.SETUP_BLOCKS[block], sizes[:, 0])
        return probabilistic_outcome(changed, block, draws, reduction)

    return _simulate_candidates(simulate, PROBABILISTIC_CANDIDATES, fitted, effort, trying, on_progress)


def probabilistic_with(candidate: str, values: Values, block: Block, size: Array) -> tuple[Values, Array]:
    """Parameters of the probabilistic model with a candidate of `size` (k,) in [0, 1], and the slope reduction (k,) in
    degrees.

    The slope reduction of `shape` is proportional to R / r - 1, with the radii of the circumscribed and the inscribed
    circle of the block; `slope_reduction` is the same for every block that is not round."""
    changed, reduction = dict(values), np.zeros(len(size))
    for zone in ("ditch", "facing"):
        if candidate == "friction":
            key = f"{zone}.friction_angle_deg"
            changed[key] = np.minimum(changed[key] + LARGEST_FRICTION_CHANGE_DEG * size, 89.0)
        elif candidate in ("momentum_half", "tangential_restitution"):
            key = f"{zone}.momentum_half_kg_m_s" if candidate == "momentum_half" else f"{zone}.{candidate}"
            changed[key] = changed[key] * SMALLEST_FACTOR**size
    out_of_round = block.radius_m / block.inradius_m - 1.0
    if candidate == SLOPE_REDUCTION and out_of_round > 1e-9:
        reduction = LARGEST_SLOPE_REDUCTION_DEG * size
    if candidate == SHAPE:
        reduction = np.minimum(LARGEST_SLOPE_REDUCTION_DEG * size * out_of_round / SQUARE_OUT_OF_ROUND, 80.0)
    return changed, reduction


def _evenly_chosen(sample: Array) -> Array:
    """At most HYPOTHESES of the hypotheses, evenly spaced, so that both halves contribute."""
    return sample[np.linspace(0, len(sample) - 1, min(HYPOTHESES, len(sample))).astype(int)]


def _releases(effort: Effort) -> int:
    return max(1, round(SHARE_OF_RELEASES * effort.releases))


def _resampled_for_sphere(values: Values, effort: Effort, seed: np.random.SeedSequence) -> dict[str, Array]:
    """Hypotheses with parameters of the probabilistic model, drawn from the prior and resampled by the likelihood of
    the sphere's row."""
    draw_seed, run_seed = seed.spawn(2)
    rng, count = np.random.default_rng(run_seed), len(values["slope_deg"])
    many = {name: np.repeat(v, REBOUND_DRAWS) for name, v in values.items()}
    many |= {q.name: q.value(rng.random(count * REBOUND_DRAWS)) for q in REBOUND_QUANTITIES}
    draws = standard_normal_draws(_releases(effort), draw_seed)["sphere"]
    likely = passing_log_likelihood(probabilistic_outcome(many, "sphere", draws), "sphere")
    weight = np.exp(likely - likely.max())
    kept = resampled(weight, count, rng)
    return {name: v[kept] for name, v in many.items()}


def _simulate_candidates(
    simulate: Simulation, candidates: Sequence[str], values: Values, effort: Effort,
    seed: np.random.SeedSequence, on_progress: OnProgress,
) -> dict[str, Array]:  # fmt: skip
    draw_seed, size_seed = seed.spawn(2)
    draws = standard_normal_draws(_releases(effort), draw_seed)
    k = len(values["slope_deg"]) * SIZES
    every_size = np.random.default_rng(size_seed).random((k, MOST_CANDIDATE_PARAMETERS))
    percent = np.empty((len(candidates), k, len(published.BLOCKS), len(published.LINES)))
    likely = np.empty(percent.shape[:3])
    for c, candidate in enumerate(candidates):
        alike = SIZES if candidate == NO_CANDIDATE else 1  # without a candidate all sizes give the same
        many = {name: np.repeat(v, SIZES // alike) for name, v in values.items()}
        for b, block in enumerate(published.BLOCKS):
            outcome = simulate(many, block, draws[block], candidate, every_size[::alike])
            percent[c, :, b] = np.repeat(100 * outcome.frequencies, alike, axis=0)
            likely[c, :, b] = np.repeat(passing_log_likelihood(outcome, block), alike)
            on_progress((c + (b + 1) / len(published.BLOCKS)) / len(candidates))
    return {"percent": percent, "log_likelihood": likely}


@dataclass(frozen=True)
class HeldOutScore:
    """The score of a candidate on blocks that were not used for its calibration.

    Attributes
    ----------
    log_score : log-probability of the filmed numbers of these blocks
    over_none, error : log_score minus that of no candidate, and its standard error over hypotheses
    percent : (blocks, lines) predicted passing frequencies of these blocks in %
    effective : effective number of hypotheses"""

    log_score: float
    over_none: float
    error: float
    percent: Array
    effective: float


def held_out_score(
    found: Mapping[str, Array], candidate: int, calibrated_on: Sequence[str], scored_on: Sequence[str], seed: int
) -> HeldOutScore:
    """The score of the candidate with this index in `found`, the arrays of `deterministic_candidates` or
    `probabilistic_candidates`; index 0 is no candidate."""
    on, scored = ([published.BLOCKS.index(b) for b in blocks] for blocks in (calibrated_on, scored_on))
    likely = found["log_likelihood"]
    known, predicted = likely[:, :, on].sum(axis=2), likely[:, :, scored].sum(axis=2)
    groups = likely.shape[1] // SIZES
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    every = np.arange(groups)
    own = _log_score(known[candidate], predicted[candidate], every)
    resampled = []
    for _ in range(RESAMPLES):
        drawn = rng.integers(0, groups, groups)
        scores = [_log_score(known[c], predicted[c], drawn) for c in (candidate, 0)]
        resampled.append(scores[0] - scores[1])
    weight = np.exp(known[candidate] - known[candidate].max())
    return HeldOutScore(
        own,
        own - _log_score(known[0], predicted[0], every),
        float(np.std(resampled)),
        np.einsum("k,kbl->bl", weight, found["percent"][candidate][:, scored]) / weight.sum(),
        float(weight.sum() ** 2 / (weight**2).sum()),
    )


def _log_score(known: Array, predicted: Array, groups: Array) -> float:
    """Logarithm of the mean of exp(`predicted`) over hypotheses with weights exp(`known`)."""
    rows = (groups[:, None] * SIZES + np.arange(SIZES)).ravel()
    top, both = known[rows].max(), (known + predicted)[rows].max()
    return float(
        both + np.log(np.exp((known + predicted)[rows] - both).sum()) - top - np.log(np.exp(known[rows] - top).sum())
    )


def missing_effects_table(found: Mapping[str, Mapping[str, Array]], seed: int) -> pd.DataFrame:
    """One row for each model, test and candidate, the best score of a test first; `found`: model -> arrays."""
    names = {"deterministic": CANDIDATES, "probabilistic": PROBABILISTIC_CANDIDATES}
    rows = []
    for model, own in found.items():
        for on, scored in TESTS:
            for c, candidate in enumerate(names[model]):
                score = held_out_score(own, c, on, scored, seed)
                row: dict[str, object] = {
                    "model": model, "calibrated_on": "+".join(on), "scored_on": "+".join(scored),
                    "candidate": candidate, "log_score": score.log_score, "over_none": score.over_none,
                    "error": score.error, "effective": score.effective,
                }  # fmt: skip
                for block, percent in zip(scored, score.percent, strict=True):
                    row |= {f"{block}_{line}": p for line, p in zip(published.LINES, percent, strict=True)}
                rows.append(row)
    table = pd.DataFrame(rows)
    order = table.groupby(["model", "calibrated_on"], sort=False)["log_score"].rank(ascending=False)
    return table.assign(rank=order.astype(int)).sort_values(["model", "calibrated_on", "rank"], ignore_index=True)
