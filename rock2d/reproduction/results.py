"""What each calibration of a reproduction predicts of releases it did not see, and what that amounts to."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from rock2d.calibration.sequential_monte_carlo import Sample
from rock2d.reproduction import published, summary
from rock2d.reproduction.hypotheses import DETERMINISTIC_SPACE, PROBABILISTIC_SPACE, Values
from rock2d.reproduction.passing import Known, Outcome, bounce, fall
from rock2d.reproduction.stages import CANDIDATE_SPACE, draws_of, fall_with_candidate, prior_of
from rock2d.reproduction.summary import LeftOut

if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray

SPACES = {"deterministic": DETERMINISTIC_SPACE, "probabilistic": PROBABILISTIC_SPACE}
FRESH = 200  # releases of each block and hypothesis that predictions are made of


@dataclass(frozen=True)
class Results:
    """All that tables and figures are made of.

    Attributes
    ----------
    samples, outcomes : model -> its posterior, and what it predicts of the three blocks' releases that no fit saw
    reduction_deg : block -> α of each hypothesis of the probabilistic model
    left_out : for the cube and the parallelepiped, what is predicted without its cells; empty without candidates
    passing, candidates, cells : tables
    errors : RMSE in points, by what was known
    said : the verdict in words
    """

    known: Known
    seed: int
    samples: dict[str, Sample]
    outcomes: dict[str, list[Outcome]]
    reduction_deg: dict[str, Array]
    left_out: list[LeftOut]
    passing: pd.DataFrame
    candidates: pd.DataFrame
    cells: pd.DataFrame
    errors: dict[str, float]
    said: list[str] = field(default_factory=list)

    def values(self, model: str) -> Values:
        """The hypotheses of a model."""
        return SPACES[model].values(self.samples[model].u)


def judge(
    known: Known, samples: dict[str, Sample], reduction_deg: dict[str, Array], tried: dict[str, Sample],
    stream: np.random.SeedSequence, seed: int,
) -> Results:  # fmt: skip
    """Predictions of all calibrations, and what they amount to. `tried`: block left out -> its posterior."""
    draw_seed, floor_seed = stream.spawn(2)
    draws = draws_of(FRESH, draw_seed)
    values = {model: SPACES[model].values(sample.u) for model, sample in samples.items()}
    outcomes = {
        "deterministic": [
            fall(known, values["deterministic"], block, draws[block]) for block in published.BLOCKS
        ],
        "probabilistic": [
            bounce(known, values["probabilistic"], block, draws[block], reduction_deg[block])
            for block in published.BLOCKS
        ],
    }
    left_out = []
    for block, sample in tried.items():
        own = CANDIDATE_SPACE.values(sample.u)
        predicted = [fall_with_candidate(known, own, b, draws[b]) for b in published.BLOCKS]
        left_out.append(LeftOut(own, predicted, block))
    cells = summary.cells_table(left_out)
    rng = np.random.default_rng(floor_seed)
    results = Results(
        known, seed, samples, outcomes, reduction_deg, left_out,
        summary.passing_table(outcomes["deterministic"], outcomes["probabilistic"]),
        summary.candidates_table(left_out), cells, _errors(outcomes, left_out, cells, rng),
    )  # fmt: skip
    results.said.extend(_said(results))
    return results


def _errors(
    outcomes: dict[str, list[Outcome]], left_out: list[LeftOut], cells: pd.DataFrame, rng: np.random.Generator
) -> dict[str, float]:
    """RMSE in points by what was known, over the validation cells and over all nine."""
    validation = summary.VALIDATION
    sphere_only = summary.mean_percent(outcomes["deterministic"])
    found = {
        "paper, deterministic: validation cells": summary.rmse(published.DETERMINISTIC, validation),
        "paper, deterministic: all nine": summary.rmse(published.DETERMINISTIC),
        "paper, probabilistic: all nine": summary.rmse(published.PROBABILISTIC),
        "deterministic: validation cells": summary.rmse(sphere_only, validation),
        "deterministic: all nine": summary.rmse(sphere_only),
        "probabilistic: all nine": summary.rmse(summary.mean_percent(outcomes["probabilistic"])),
        "deterministic, the best hypothesis: all nine": summary.best_rmse(outcomes["deterministic"]),
        "probabilistic, the best hypothesis: all nine": summary.best_rmse(outcomes["probabilistic"]),
    }
    if left_out:
        found |= {
            "deterministic, told the sphere and the other angular block: validation cells": _rms(
                [summary.plain_rmse(run) for run in left_out]
            ),
            "deterministic, told all cells but the one predicted: validation cells": _rms(
                cells["predicted"] - cells["experiment"]
            ),
            "deterministic, told all nine, the best hypothesis: all nine": float(
                np.nanmin([summary.best_rmse(run.plain) for run in left_out])
            ),
        }
    for name, chosen in (("validation cells", validation), ("all nine", np.s_[:])):
        mean, bound = summary.sampling_floor(chosen, rng)
        found |= {f"a perfect model: {name}": mean, f"a perfect model, 95th percentile: {name}": bound}
    return found


def _rms(values: object) -> float:
    return float(np.sqrt(np.mean(np.square(np.asarray(values, float)))))


def _said(results: Results) -> list[str]:
    """The verdict in words."""
    e, rows = results.errors, results.passing.to_dict("records")
    outside = [r for r in rows if not r["experiment_low95"] <= r["deterministic"] <= r["experiment_high95"]]
    misses = [r for r in rows if r["deterministic_p"] < 0.05]
    lines = [
        f"Deterministic model, told the sphere's cells and the words on first impacts: RMSE "
        f"{e['deterministic: validation cells']:.1f} points over the validation cells (paper "
        f"{e['paper, deterministic: validation cells']:.1f}), {e['deterministic: all nine']:.1f} over all nine (paper "
        f"{e['paper, deterministic: all nine']:.1f}).",
        f"Probabilistic model: {e['probabilistic: all nine']:.1f} over all nine (paper "
        f"{e['paper, probabilistic: all nine']:.1f}).",
        f"A perfect model would show {e['a perfect model: validation cells']:.1f} and "
        f"{e['a perfect model: all nine']:.1f} against {published.RELEASES} releases.",
        f"Mean predictions of the deterministic model outside the experiment's 95 % interval: {_cells(outside)}; "
        f"filmed numbers that its predictions exclude (p < 0.05): {_cells(misses)}.",
    ]
    for model, own in results.outcomes.items():
        lines.append(
            f"Monte Carlo error of the {model} model's mean predictions: {summary.halves_differ(own):.1f} points."
        )
    if not results.left_out:
        return lines
    shares = results.candidates.pivot(index="candidate", columns="left_out", values="share_told_all")
    mean, apart = shares.mean(axis=1).sort_values(ascending=False), shares.max(axis=1) - shares.min(axis=1)
    likeliest = [
        f"{name} {mean[name]:.2f} ± {apart[name] / 2:.2f} (prior {prior_of(str(name)):.2f})"
        for name in mean.index[:3]
    ]
    return [*lines, f"Candidate physics, once all cells are told: {', '.join(likeliest)}."]


def _cells(rows: list[dict[Hashable, Any]]) -> str:
    return ", ".join(f"{r['block']} {r['line']}" for r in rows) or "none"
