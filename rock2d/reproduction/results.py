"""What each calibration of a reproduction predicts of releases it did not see, and what that amounts to."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from rock2d.calibration import Sample
from rock2d.reproduction import published, summary
from rock2d.reproduction.passing import Known, Outcome, bounce, fall
from rock2d.reproduction.stages import (
    CANDIDATE_SPACE,
    FULL_SPACE,
    NONE,
    PROBABILISTIC_SPACE,
    fall_with_candidate,
)
from rock2d.reproduction.summary import LeftOut

if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray

FRESH = 200  # releases of each block and hypothesis that predictions are made of


@dataclass(frozen=True)
class Results:
    """All that tables and figures are made of.

    Attributes
    ----------
    calibrated, rebound : posteriors in FULL_SPACE, PROBABILISTIC_SPACE
    reduction_deg : block -> α of each hypothesis of `rebound`
    deterministic, probabilistic : outcomes of the three blocks, releases that no fit saw
    left_out : for the cube and the parallelepiped, what is predicted without its cells
    passing, candidates, cells : tables
    shown : index into `rebound` of the hypothesis that the drawings show: the likeliest
    errors : RMSE in points by what was known
    said : the verdict in words
    """

    known: Known
    seed: int
    calibrated: Sample
    rebound: Sample
    reduction_deg: dict[str, Array]
    deterministic: list[Outcome]
    probabilistic: list[Outcome]
    left_out: list[LeftOut]
    passing: pd.DataFrame
    candidates: pd.DataFrame
    cells: pd.DataFrame
    shown: int
    errors: dict[str, float]
    said: list[str] = field(default_factory=list)


def judge(
    known: Known, calibrated: Sample, rebound: Sample, reduction_deg: dict[str, Array], tried: dict[str, Sample],
    stream: np.random.SeedSequence, seed: int,
) -> Results:  # fmt: skip
    """Predictions of all calibrations, and what they amount to. `tried`: block left out -> its posterior."""
    draw_seed, floor_seed = stream.spawn(2)
    draws = {
        block: np.random.default_rng(child).standard_normal((FRESH, 6))
        for block, child in zip(published.BLOCKS, draw_seed.spawn(len(published.BLOCKS)), strict=True)
    }
    values = FULL_SPACE.values(calibrated.u)
    deterministic = [fall(known, values, block, draws[block]) for block in published.BLOCKS]
    values = PROBABILISTIC_SPACE.values(rebound.u)
    probabilistic = [
        bounce(known, values, block, draws[block], reduction_deg[block]) for block in published.BLOCKS
    ]
    left_out = []
    for block, sample in tried.items():
        values = CANDIDATE_SPACE.values(sample.u)
        outcomes = [fall_with_candidate(known, values, b, draws[b]) for b in published.BLOCKS]
        left_out.append(LeftOut(values, outcomes, block))
    passing = summary.passing_table(
        [o.frequencies for o in deterministic], [o.frequencies for o in probabilistic]
    )
    cells = summary.cells_table(left_out)
    rng = np.random.default_rng(floor_seed)
    results = Results(
        known, seed, calibrated, rebound, reduction_deg, deterministic, probabilistic, left_out, passing,
        summary.candidates_table(left_out), cells, rebound.best,
        _errors(deterministic, probabilistic, left_out, cells, rng),
    )  # fmt: skip
    results.said.extend(_said(results))
    return results


def _errors(
    deterministic: list[Outcome], probabilistic: list[Outcome], left_out: list[LeftOut], cells: pd.DataFrame,
    rng: np.random.Generator,
) -> dict[str, float]:  # fmt: skip
    """RMSE in points by what was known, over the validation cells and over all nine."""
    validation, every = summary.VALIDATION, np.s_[:]
    sphere_only = summary.mean_percent(deterministic)
    found = {
        "paper_deterministic_validation": summary.rmse(published.DETERMINISTIC, validation),
        "paper_deterministic_all": summary.rmse(published.DETERMINISTIC),
        "paper_probabilistic_all": summary.rmse(published.PROBABILISTIC),
        "deterministic_validation": summary.rmse(sphere_only, validation),
        "deterministic_all": summary.rmse(sphere_only),
        "probabilistic_all": summary.rmse(summary.mean_percent(probabilistic)),
        "deterministic_one_block_left_out": _rms([summary.plain_rmse(run) for run in left_out]),
        "deterministic_one_cell_left_out": _rms(cells["predicted"] - cells["experiment"]),
        "deterministic_told_all_nine": min(summary.best_rmse(run.plain) for run in left_out),
        "probabilistic_told_all_nine": summary.best_rmse(probabilistic),
    }
    for name, chosen in (("validation", validation), ("all", every)):
        found[f"floor_{name}"], found[f"floor_{name}_95"] = summary.sampling_floor(chosen, rng)
    return found


def _rms(values: object) -> float:
    return float(np.sqrt(np.mean(np.square(np.asarray(values, float)))))


def _said(results: Results) -> list[str]:
    """The verdict in words."""
    e, table, tried = results.errors, results.passing, results.candidates
    outside = [
        f"{r['block']} {r['line']}"
        for r in table.to_dict("records")
        if not r["experiment_low95"] <= r["deterministic"] <= r["experiment_high95"]
    ]
    misses = [f"{r['block']} {r['line']}" for r in table.to_dict("records") if r["deterministic_p"] < 0.05]
    lines = [
        f"Deterministic, calibrated on the sphere and the words on first impacts: RMSE "
        f"{e['deterministic_validation']:.1f} points over the validation cells (paper "
        f"{e['paper_deterministic_validation']:.1f}), {e['deterministic_all']:.1f} over all nine (paper "
        f"{e['paper_deterministic_all']:.1f}).",
        f"Probabilistic: {e['probabilistic_all']:.1f} over all nine (paper {e['paper_probabilistic_all']:.1f}).",
        f"A perfect model would show {e['floor_validation']:.1f} and {e['floor_all']:.1f} against "
        f"{published.RELEASES} releases.",
        f"What the unpublished starts are worth: told the other angular block's cells "
        f"{e['deterministic_one_block_left_out']:.1f}, told a block's other two cells "
        f"{e['deterministic_one_cell_left_out']:.1f}, the best hypothesis for all nine "
        f"{e['deterministic_told_all_nine']:.1f} (probabilistic {e['probabilistic_told_all_nine']:.1f}).",
        f"Mean predictions of the deterministic model outside the experiment's 95 % interval: "
        f"{', '.join(outside) or 'none'}; filmed numbers that its predictions exclude (p < 0.05): "
        f"{', '.join(misses) or 'none'}.",
    ]
    for block, own in tried.groupby("left_out", sort=False):
        plain = own[own["candidate"] == NONE].iloc[0]
        best = own.sort_values("share_told_all").iloc[-1]
        lines.append(
            f"Candidate physics, {block} left out: likeliest once it is told {best['candidate']} "
            f"({best['share_told_all']:.2f}), none {plain['share_told_all']:.2f} (prior 0.50)."
        )
    return lines
