"""How far the gap shrinks, and where it lies: on releases that no fit saw.

The *gap* of a model is the mean square of its held-out residuals in standard deviations of what noise and the soil's
own scatter leave (one number per channel of every impact and flight, clipped). The floor is what is left once a
flexible regression has taken away all that can be predicted: what no model could explain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rock2d.diagnosis.attribution import Attribution
from rock2d.diagnosis.candidate import Candidate
from rock2d.diagnosis.cross_validation import HeldOut
from rock2d.diagnosis.data import Data
from rock2d.diagnosis.residual_regression import FLIGHT_DEGREES, RegressedResiduals, clipped

Array = np.ndarray

BOOTSTRAPS = 1000
GAP_UNIT = "mean square residual over the variance that noise and the soil's scatter leave"


@dataclass
class Gap:
    """Gap of the base, of the model with the effect, and the floor; closure = (base - augmented) / (base - floor)."""

    base: float
    augmented: float
    floor: float
    closure: float
    ci95: tuple[float, float]


def squares(data: Data, out: HeldOut, covariance: Array) -> tuple[Array, Array]:
    """Clipped squares of held-out residuals in standard deviations: impacts (n, d), flights (m, 3 × degrees)."""
    scale = np.sqrt(np.maximum(np.diagonal(covariance, axis1=1, axis2=2), 1e-300))
    flights = clipped(out.residuals.flights[:, :, :FLIGHT_DEGREES]).reshape(
        len(out.residuals.flights), 3 * FLIGHT_DEGREES
    )
    return clipped(out.residuals.impacts / scale) ** 2, flights**2


def per_release(data: Data, impacts: Array, flights: Array) -> Array:
    """(releases,) sums over impacts and flights."""
    n = len(data.order)
    total = np.bincount(data.impact_release, impacts.sum(axis=1), n)
    return total + np.bincount(data.flight_release, flights.sum(axis=1), n)


def gap_of(data: Data, found: Attribution, candidate: Candidate, seed: int) -> Gap:
    """Gap that an effect closes, with a bootstrap interval over releases."""
    covariance = found.final.fit.covariance()
    base = per_release(data, *squares(data, found.base_held_out, covariance))
    augmented = per_release(data, *squares(data, candidate.held_out, covariance))
    if candidate.effect.scatter:
        # a wider scatter shifts no mean: its gap is how far the spread that a model states is from the spread seen
        base, augmented = _misstated(data, found, candidate)
    floors = _floors(data, found.base_regressed, found.best_regressed)
    if candidate.effect.scatter:
        floors = np.zeros((1, len(base)))
    count = per_release(
        data, np.ones_like(found.base_regressed.impacts), np.ones_like(found.base_regressed.flights)
    )
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    draws = rng.multinomial(len(base), np.full(len(base), 1.0 / len(base)), size=BOOTSTRAPS)
    b, a, f = draws @ base, draws @ augmented, (draws @ floors.T).min(axis=1)
    floor = floors[floors.sum(axis=1).argmin()]
    low, high, closure = 0.0, 0.0, 0.0
    if np.quantile(b - f, 0.025) > 0:  # else there is no gap to close
        low, high = np.quantile((b - a) / np.maximum(b - f, 1e-12), [0.025, 0.975])
        closure = (base.sum() - augmented.sum()) / (base.sum() - floor.sum())
    total = count.sum()
    return Gap(
        base.sum() / total,
        augmented.sum() / total,
        floor.sum() / total,
        float(closure),
        (float(low), float(high)),
    )


def share_closed_by_regression(data: Data, found: Attribution) -> float:
    """Closure of a flexible regression on top of the base law, without effects; 0 where nothing is to close."""
    floors = _floors(data, found.base_regressed, found.best_regressed).sum(axis=1)
    base, flexible = floors[2], floors[3]
    return float((base - flexible) / (base - floors.min())) if base > floors.min() else 0.0


def _floors(data: Data, base_regressed: RegressedResiduals, best_regressed: RegressedResiduals) -> Array:
    """(4, releases) squares that the best effect, a regression on top of it, the base and a regression on top of that
    leave unexplained; the least of them is the floor, in every bootstrap draw its own."""
    return np.array([
        per_release(data, impacts**2, flights**2)
        for impacts, flights in (
            (best_regressed.impacts, best_regressed.flights),
            (best_regressed.impacts_remaining, best_regressed.flights_remaining),
            (base_regressed.impacts, base_regressed.flights),
            (base_regressed.impacts_remaining, base_regressed.flights_remaining),
        )
    ])  # fmt: skip


def _misstated(data: Data, found: Attribution, candidate: Candidate) -> tuple[Array, Array]:
    """(releases,) minus the log likelihood that base and augmented model give, above that of the better of the two."""
    base, augmented = -found.base_held_out.score, -candidate.held_out.score
    return base - np.minimum(base.sum(), augmented.sum()) / len(base), augmented - np.minimum(
        base.sum(), augmented.sum()
    ) / len(base)


@dataclass
class Cell:
    """One place where the gap lies: share of the whole, significance."""

    phase: str
    zone: str
    block: str
    channel: str
    share: float
    z: float


@dataclass
class Part:
    """Squares that the best explanation takes away from the base's (n, channels), and where each row belongs."""

    phase: str
    taken: Array
    zone: Array
    block: Array
    release: Array
    channels: tuple[str, ...]
    columns: tuple[list[int], ...]  # of `taken`, for each channel


IMPACT_CHANNELS = ("tangential", "normal", "spin")
FLIGHT_CHANNELS = ("x", "y", "theta")


def explained(found: Attribution) -> tuple[Array, Array]:
    """Squares that the best explanation takes away from impacts and flights: that of the best effect, with the flexible
    regression on top where that finds more, or of the regression alone where no effect helps."""
    base, best = found.base_regressed, found.best_regressed
    impacts = min(
        (best.impacts, best.impacts_remaining, base.impacts_remaining), key=lambda v: float((v**2).sum())
    )
    flights = min(
        (best.flights, best.flights_remaining, base.flights_remaining), key=lambda v: float((v**2).sum())
    )
    return base.impacts**2 - impacts**2, base.flights**2 - flights**2


def impact_part(
    found: Attribution, zone: Array, block: Array, release: Array, bare: Array | None = None
) -> Part:
    """Impacts, by direction along the ground, across it, and spin. `bare` (n, d): residuals of the law without the
    effect, if others are to be explained than those of the base."""
    taken, _ = explained(found)
    if found.verdict == found.best and any(c.effect.scatter for c in found.chain):
        taken = _spread_stated(found)  # no mean shifts: `bare` has nothing to say
    elif bare is not None:
        covariance = found.final.fit.covariance()
        scale = np.sqrt(np.maximum(np.diagonal(covariance, axis1=1, axis2=2), 1e-300))
        taken = clipped(bare / scale) ** 2 - found.base_regressed.impacts**2 + taken
    columns = tuple(list(range(c, taken.shape[1], 3)) for c in range(3))
    return Part("impact", taken, zone, block, release, IMPACT_CHANNELS, columns)


def _spread_stated(found: Attribution) -> Array:
    """(n, channels) gain of each channel's deviance where an effect shifts no mean but widens what a model expects."""
    deviance = []
    for fitted, out in (
        (found.base, found.base_held_out),
        (found.final.fit, found.final.held_out),
    ):
        variance = np.maximum(np.diagonal(fitted.covariance(), axis1=1, axis2=2), 1e-300)
        deviance.append(clipped(out.residuals.impacts / np.sqrt(variance)) ** 2 + np.log(variance))
    return np.asarray(deviance[0] - deviance[1])


def flight_part(found: Attribution, zone: Array, block: Array, release: Array) -> Part:
    """Flights, by coordinate."""
    _, taken = explained(found)
    columns = tuple(list(range(FLIGHT_DEGREES * c, FLIGHT_DEGREES * (c + 1))) for c in range(3))
    return Part("flight", taken, zone, block, release, FLIGHT_CHANNELS, columns)


def where(parts: Sequence[Part], zones: Sequence[str], blocks: Sequence[str]) -> list[Cell]:
    """Where the base is wrong, by phase, zone, block and channel: largest share first.

    Shares of what stands out of chance (or, if nothing does, of what there is) sum to 1. Where blocks come to rest is
    what their impacts led to, and no part of the gap: it is told only where nothing else stands out.
    """
    cells = []
    for part in parts:
        for z in np.unique(part.zone):
            for b in np.unique(part.block):
                own = (part.zone == z) & (part.block == b)
                for channel, columns in zip(part.channels, part.columns, strict=True):
                    amount = part.taken[own][:, columns].sum(axis=1)
                    if amount.size and amount.sum() > 0:
                        sigma = _significance(amount, part.release[own])
                        cells.append(
                            Cell(
                                part.phase, zones[int(z)], blocks[int(b)], channel, float(amount.sum()), sigma
                            )
                        )
    sure = [cell for cell in cells if cell.z > 2.0]
    sure = [cell for cell in sure if cell.phase != "rest"] or sure or cells
    total = sum(cell.share for cell in sure)
    for cell in sure:
        cell.share /= total
    return sorted(sure, key=lambda cell: -cell.share)


def _significance(amount: Array, release: Array) -> float:
    """Sum over its standard error, with releases as clusters; by chance alone a square moves by about √2."""
    clusters = np.bincount(release, amount)[np.unique(release)]
    return float(amount.sum() / np.hypot(clusters.std() * np.sqrt(len(clusters)), np.sqrt(2.0 * len(amount))))
