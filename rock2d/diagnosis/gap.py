"""The sim-to-real gap: how large it is, which share of it an effect closes, and where it lies, on held-out releases.

The *gap* of a model is the mean square of its held-out residuals, in standard deviations of noise and the soil's
scatter (one number for each channel of every impact and flight, clipped). The *noise floor* is the mean square that
remains after a flexible regression has subtracted everything that it can predict.
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

GAP_BOOTSTRAPS = 1000
SIGNIFICANT_CELL_Z = 2.0
GAP_UNIT = "mean square residual over the variance that noise and the soil's scatter leave"


@dataclass
class Gap:
    """Gap of the base, of the model with the effect (`augmented`), and the noise floor.

    share_closed = (base - augmented) / (base - floor), with its 95 % interval.
    """

    base: float
    augmented: float
    floor: float
    share_closed: float
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
        # a wider scatter shifts no mean: its gap is the difference between the stated and the observed spread
        base, augmented = _misstated(data, found, candidate)
    floors = _floors(data, found.base_regressed, found.best_regressed)
    if candidate.effect.scatter:
        floors = np.zeros((1, len(base)))
    count = per_release(
        data, np.ones_like(found.base_regressed.impacts), np.ones_like(found.base_regressed.flights)
    )
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    draws = rng.multinomial(len(base), np.full(len(base), 1.0 / len(base)), size=GAP_BOOTSTRAPS)
    b, a, f = draws @ base, draws @ augmented, (draws @ floors.T).min(axis=1)
    floor = floors[floors.sum(axis=1).argmin()]
    low, high, share_closed = 0.0, 0.0, 0.0
    if np.quantile(b - f, 0.025) > 0:  # else there is no gap to close
        low, high = np.quantile((b - a) / np.maximum(b - f, 1e-12), [0.025, 0.975])
        share_closed = (base.sum() - augmented.sum()) / (base.sum() - floor.sum())
    total = count.sum()
    return Gap(
        base.sum() / total,
        augmented.sum() / total,
        floor.sum() / total,
        float(share_closed),
        (float(low), float(high)),
    )


def share_closed_by_regression(data: Data, found: Attribution) -> float:
    """Share of the gap that a flexible regression on top of the base law closes, without effects; 0 without a gap."""
    floors = _floors(data, found.base_regressed, found.best_regressed).sum(axis=1)
    _, _, base, flexible = floors
    return float((base - flexible) / (base - floors.min())) if base > floors.min() else 0.0


def _floors(data: Data, base_regressed: RegressedResiduals, best_regressed: RegressedResiduals) -> Array:
    """(4, releases) squares of the residuals of the best effect, of a regression on top of it, of the base and of a
    regression on top of that. The smallest sum is the floor, separately in every bootstrap draw."""
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
    """(releases,) minus the log likelihood of base and augmented model, relative to the better of the two."""
    base, augmented = -found.base_held_out.score, -candidate.held_out.score
    return base - np.minimum(base.sum(), augmented.sum()) / len(base), augmented - np.minimum(
        base.sum(), augmented.sum()
    ) / len(base)


@dataclass
class Cell:
    """One place where the gap lies, its share of the whole and its significance in standard errors."""

    phase: str
    zone: str
    block: str
    channel: str
    share: float
    z: float


@dataclass
class Part:
    """Squares by which the best explanation reduces those of the base (n, channels), and where each row belongs."""

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
    """Squares by which the best explanation reduces those of impacts and flights: the best effect, with the flexible
    regression on top where it finds more, or the regression alone where no effect helps."""
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
    effect, if they and not those of the base are to be explained."""
    taken, _ = explained(found)
    if found.verdict == found.best and any(c.effect.scatter for c in found.chain):
        taken = _spread_stated(found)  # no mean shifts, so `bare` does not matter
    elif bare is not None:
        covariance = found.final.fit.covariance()
        scale = np.sqrt(np.maximum(np.diagonal(covariance, axis1=1, axis2=2), 1e-300))
        taken = clipped(bare / scale) ** 2 - found.base_regressed.impacts**2 + taken
    columns = tuple(list(range(c, taken.shape[1], 3)) for c in range(3))
    return Part("impact", taken, zone, block, release, IMPACT_CHANNELS, columns)


def _spread_stated(found: Attribution) -> Array:
    """(n, channels) gain in deviance of each channel, for an effect that shifts no mean but widens the spread."""
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

    The shares of the significant places sum to 1, or of all places if none is significant. Where blocks come to rest
    follows from their impacts and is no part of the gap. It is listed only if nothing else is significant.
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
    significant = [cell for cell in cells if cell.z > SIGNIFICANT_CELL_Z]
    shown = [cell for cell in significant if cell.phase != "rest"] or significant or cells
    total = sum(cell.share for cell in shown)
    for cell in shown:
        cell.share /= total
    return sorted(shown, key=lambda cell: -cell.share)


def _significance(amount: Array, release: Array) -> float:
    """Sum over its standard error, with releases as clusters; by chance alone a square varies by about √2."""
    clusters = np.bincount(release, amount)[np.unique(release)]
    return float(amount.sum() / np.hypot(clusters.std() * np.sqrt(len(clusters)), np.sqrt(2.0 * len(amount))))
