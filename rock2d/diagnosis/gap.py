"""The sim-to-real gap: which share of it each model closes, and where it lies, on held-out releases.

`budget` defines the size of a gap. Its floor follows from the lower of two estimates: the residuals that a flexible
regression cannot predict, and the differences of near-replicates (`replicates`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rock2d.diagnosis.attribution import Attribution, Candidate
from rock2d.diagnosis.budget import SMALLEST_SD, Budget, GapBootstrap, ResidualSizes, Share, budget, share
from rock2d.diagnosis.data import Data
from rock2d.diagnosis.likelihood import standard_deviations
from rock2d.diagnosis.replicates import replicate_ratio
from rock2d.diagnosis.residual_regression import FLIGHT_DEGREES, clipped

Array = np.ndarray

SIGNIFICANT_CELL_Z = 2.0


class Gaps:
    """The gap of an attribution: its budget, and the share that each effect closes alone."""

    def __init__(self, data: Data, attribution: Attribution, seed: int) -> None:
        covariance = attribution.final.fit.covariance()
        self._sizes = sizes = ResidualSizes(data, covariance)
        self._draws = GapBootstrap(sizes, seed)
        base, learnt = (
            sizes.of(attribution.base_held_out.residuals),
            sizes.of(attribution.learnt.held_out.residuals),
        )
        regression = sizes.of_remaining(attribution.learnt_regressed)
        world = attribution.final.fit.model.world(attribution.final.fit.p, data.impact_order)
        ratio = replicate_ratio(data, world, clipped(sizes.z(attribution.learnt.held_out.residuals)))
        gap = self._draws.gap
        floors = gap(regression), self._draws.gap_after_reduction(learnt, sizes.impacts, ratio)
        self._base, flexible = gap(base), gap(sizes.of_remaining(attribution.base_regressed))
        self._floor = self._draws.floor([*floors, flexible], [self._base])
        sets = {names: sizes.of(own.held_out.residuals) for names, own in attribution.sets.items()}
        self.budget: Budget = budget(sets, attribution.named, learnt, floors, self._draws)

    def of(self, candidate: Candidate) -> Share:
        """Share of the gap that a candidate closes."""
        augmented = self._draws.gap(self._sizes.of(candidate.held_out.residuals))
        return share(self._base - augmented, self._base - np.minimum(self._floor, augmented))


@dataclass
class Cell:
    """One place where the gap lies.

    Attributes
    ----------
    phase, zone, block, channel : the place
    share : share of the whole gap
    z : significance of the share, in standard errors
    base, augmented : typical residual there, of the base law and of the best model
    """

    phase: str
    zone: str
    block: str
    channel: str
    share: float
    z: float
    base: float
    augmented: float


@dataclass
class Part:
    """Squares of residuals (n, 3 channels, squares of each), with zone, block and release (n,) of each row.

    Attributes
    ----------
    explained : reduction of the squares of the base law by the best explanation
    base, augmented : squares of the base law and of the best model
    """

    phase: str
    explained: Array
    base: Array
    augmented: Array
    zone: Array
    block: Array
    release: Array


IMAGE_CHANNELS = ("x", "y", "theta")
CHANNELS = {
    "impact": ("tangential", "normal", "spin"),
    "flight": IMAGE_CHANNELS,
    "rest": IMAGE_CHANNELS,
}


def _explained_squares(attribution: Attribution, kind: str) -> Array:
    """Reduction of the squares of "impacts" or "flights" by the best explanation: the best model, if useful with the
    flexible regression on top, or the regression alone."""
    base, better, remaining = (
        attribution.base_regressed,
        (attribution.best_regressed, attribution.learnt_regressed),
        f"{kind}_remaining",
    )
    left = [getattr(base, remaining), *(getattr(own, name) for own in better for name in (kind, remaining))]
    return np.asarray(getattr(base, kind) ** 2 - min(left, key=lambda v: float((v**2).sum())) ** 2)


def impact_part(
    attribution: Attribution, zone: Array, block: Array, release: Array, bare: Array | None = None
) -> Part:
    """Squares of impacts along the ground, across it, and of the spin. `bare` (n, d): residuals of the law without the
    effect, if these are to be explained instead of those of the base."""
    explained = _explained_squares(attribution, "impacts")
    if attribution.verdict == attribution.best and any(c.effect.scatter for c in attribution.chain):
        explained = _explained_spread(attribution)  # no mean shifts, so `bare` does not matter
    elif bare is not None:
        scale = standard_deviations(attribution.final.fit.covariance())
        explained = clipped(bare / scale) ** 2 - attribution.base_regressed.impacts**2 + explained
    squares = np.stack(
        [explained, attribution.base_regressed.impacts**2, attribution.learnt_regressed.impacts**2]
    )
    n, d = explained.shape
    explained, base, left = squares.reshape(3, n, d // 3, 3).swapaxes(2, 3)
    return Part("impact", explained, base, left, zone, block, release)


def _explained_spread(attribution: Attribution) -> Array:
    """(n, channels) gain in deviance, for an effect that widens the spread and shifts no mean."""
    deviance = []
    for fitted, out in (
        (attribution.base, attribution.base_held_out),
        (attribution.final.fit, attribution.final.held_out),
    ):
        variance = np.maximum(np.diagonal(fitted.covariance(), axis1=1, axis2=2), 1e-300)
        deviance.append(clipped(out.residuals.impacts / np.sqrt(variance)) ** 2 + np.log(variance))
    return np.asarray(deviance[0] - deviance[1])


def flight_part(attribution: Attribution, zone: Array, block: Array, release: Array) -> Part:
    """Squares of flights, by coordinate."""
    explained = _explained_squares(attribution, "flights")
    squares = np.stack(
        [explained, attribution.base_regressed.flights**2, attribution.learnt_regressed.flights**2]
    )
    explained, base, left = squares.reshape(3, len(explained), 3, FLIGHT_DEGREES)
    return Part("flight", explained, base, left, zone, block, release)


def gap_cells(parts: Sequence[Part], zones: Sequence[str], blocks: Sequence[str]) -> list[Cell]:
    """The gap by phase, zone, block and channel, largest share first.

    The shares of the significant places sum to 1; if none is significant, those of all places. Where blocks come to
    rest follows from their impacts and is not a part of the gap. It is listed only if nothing else is significant.
    """
    cells = []
    for part in parts:
        for z in np.unique(part.zone):
            for b in np.unique(part.block):
                rows = (part.zone == z) & (part.block == b)
                for c, channel in enumerate(CHANNELS[part.phase]):
                    amount = part.explained[rows, c].sum(axis=1)
                    if amount.size and amount.sum() > 0:
                        sigma = _significance(amount, part.release[rows])
                        sizes = [typical_size(v[rows, c]) for v in (part.base, part.augmented)]
                        place = part.phase, zones[int(z)], blocks[int(b)], channel
                        cells.append(Cell(*place, float(amount.sum()), sigma, *sizes))
    significant = [cell for cell in cells if cell.z > SIGNIFICANT_CELL_Z]
    shown = [cell for cell in significant if cell.phase != "rest"] or significant or cells
    total = sum(cell.share for cell in shown)
    for cell in shown:
        cell.share /= total
    return sorted(shown, key=lambda cell: -cell.share)


def typical_size(squares: Array) -> float:
    """Geometric mean of the sizes of residuals, from their squares (n, columns)."""
    return float(np.exp(0.5 * np.log(np.maximum(squares.mean(axis=1), SMALLEST_SD**2)).mean()))


def _significance(amount: Array, release: Array) -> float:
    """Sum divided by its standard error, with releases as clusters; a squared standard normal residual has a standard
    deviation of √2."""
    clusters = np.bincount(release, amount)[np.unique(release)]
    return float(amount.sum() / np.hypot(clusters.std() * np.sqrt(len(clusters)), np.sqrt(2.0 * len(amount))))
