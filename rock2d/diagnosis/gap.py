"""The sim-to-real gap: which share of it each model closes, and where it lies, on held-out releases.

`budget` defines the size of a gap. Its floor follows from the lower of two estimates: the residuals that a flexible
regression cannot predict, and the differences of near-replicates (`replicates`).

Rests, the ends of the releases, are predicted from the last measured flight. Fits do not use them, because a long roll
on the ground depends little on impacts and much on chance: so they are always held out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rock2d.arrays import Array
from rock2d.diagnosis.attribution import Attribution
from rock2d.diagnosis.budget import SMALLEST_SD, Budget, GapBootstrap, ResidualSizes, Share, budget, share
from rock2d.diagnosis.data import Data, FilmData
from rock2d.diagnosis.derivatives import DIFFERENCE_STEP
from rock2d.diagnosis.fitting import Fit
from rock2d.diagnosis.likelihood import standard_deviations
from rock2d.diagnosis.model import BASE_WIDTH
from rock2d.diagnosis.replicates import replicate_ratio
from rock2d.diagnosis.residual_regression import FLIGHT_DEGREES, clipped
from rock2d.engines.batch import run_world
from rock2d.files.experiment import Experiment
from rock2d.kinematics.rest_poses import REST_FRAMES
from rock2d.kinematics.states import centroid_poses
from rock2d.records.columns import N_STATE, THETA, X
from rock2d.scene.cross_section import CrossSection
from rock2d.scene.world import World

SIGNIFICANT_CELL_Z = 2.0  # standard errors from which on the gap in a place is significant


def budget_and_shares(data: Data, attribution: Attribution, seed: int) -> tuple[Budget, dict[str, Share]]:
    """The budget of the gap, and effect -> share of the gap that it closes alone; `seed` of the bootstrap."""
    final, learnt = attribution.final.fit, attribution.learnt.held_out.residuals
    sizes = ResidualSizes(data, final.covariance())
    draws = GapBootstrap(sizes, seed)
    ratio = replicate_ratio(data, final.model.world(final.p, data.impact_order), clipped(sizes.z(learnt)))
    floors = (
        draws.gap(sizes.of_remaining(attribution.learnt_regressed)),
        draws.gap_after_reduction(sizes.of(learnt), sizes.impacts, ratio),
    )
    sets = {names: sizes.of(own.held_out.residuals) for names, own in attribution.sets.items()}
    base = draws.gap(sizes.of(attribution.base.held_out.residuals))
    floor = draws.floor([*floors, draws.gap(sizes.of_remaining(attribution.base_regressed))], [base])
    shares = {}
    for name, candidate in attribution.candidates.items():
        augmented = draws.gap(sizes.of(candidate.held_out.residuals))
        shares[name] = share(base - augmented, base - np.minimum(floor, augmented))
    return budget(sets, attribution.named, sizes.of(learnt), floors, draws), shares


@dataclass
class Cell:
    """One place where the gap lies.

    Attributes
    ----------
    phase, zone, block, channel : the place
    share : share of the whole gap
    z : significance of the share, in standard errors
    base, augmented : typical residual there, of the base law and of the best model"""

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
    base, augmented : squares of the base law and of the best model"""

    phase: str
    explained: Array
    base: Array
    augmented: Array
    zone: Array
    block: Array
    release: Array


IMAGE_CHANNELS = ("x", "y", "theta")
CHANNELS = {"impact": ("tangential", "normal", "spin"), "flight": IMAGE_CHANNELS, "rest": IMAGE_CHANNELS}


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


def _impact_part(data: Data, attribution: Attribution) -> Part:
    """Squares of impacts along the ground, across it, and of the spin."""
    final, explained = attribution.final.fit, _explained_squares(attribution, "impacts")
    first, left = (own.impacts**2 for own in (attribution.base_regressed, attribution.learnt_regressed))
    answer = attribution.answer
    if answer is not None and any(c.effect.scatter for c in attribution.chain):
        explained = _explained_spread(attribution)
    elif answer is not None and not answer.effect.camera:
        # The parameters of the base have adapted to the effect everywhere, and air forces change impacts, too. The law
        # that was fitted with the effect, with its air forces, shows where the ground is wrong.
        law = attribution.base.fit.model.world(final.p[: len(BASE_WIDTH)], data.impact_order)
        for effect, values in zip(final.model.effects, final.model.values(final.p), strict=True):
            law = final.model.applied(effect, law, values) if effect.phase == "flight" else law
        bare = data.residuals(law).impacts / standard_deviations(final.covariance())
        explained = clipped(bare) ** 2 - first + explained
    n, d = explained.shape
    explained, first, left = (own.reshape(n, d // 3, 3).swapaxes(1, 2) for own in (explained, first, left))
    return Part("impact", explained, first, left, data.impact_zone, data.impact_block, data.impact_release)


def _flight_part(data: FilmData, attribution: Attribution, ground: CrossSection) -> Part:
    """Squares of flights, by coordinate."""
    first, left = attribution.base_regressed.flights**2, attribution.learnt_regressed.flights**2
    squares = (_explained_squares(attribution, "flights"), first, left)
    explained, first, left = (own.reshape(len(own), 3, FLIGHT_DEGREES) for own in squares)
    best = attribution.final.fit
    # with the stated set-up, a mirrored film would be on the wrong side
    middle = data.states(best.model.world(best.p, data.impact_order)).middle
    zone, flights = zone_below(ground, middle[:, X]), data.flights
    return Part("flight", explained, first, left, zone, flights.block, flights.release)


def _rest_part(data: FilmData, attribution: Attribution, ground: CrossSection, rests: Rests) -> Part:
    """Squares of the ends of the releases, by coordinate."""
    best = attribution.final.fit
    variance = rest_variance(data, rests, best)
    before, after = (rest_squares(data, rests, fit, variance)[..., None] for fit in (attribution.base.fit, best))
    block, release = data.flights.block[rests.flight], data.flights.release[rests.flight]
    return Part("rest", before - after, before, after, zone_below(ground, rests.pose[:, X]), block, release)


def zone_below(cross_section: CrossSection, x: Array) -> Array:
    """(n,) zone of the ground below positions x."""
    facet = np.searchsorted(cross_section.points_m[1:, X], x)
    return cross_section.zone_ids[np.clip(facet, 0, len(cross_section.zones) - 1)]


def _explained_spread(attribution: Attribution) -> Array:
    """(n, channels) gain in deviance, for an effect that widens the spread and shifts no mean."""
    deviance = []
    for model in (attribution.base, attribution.final):
        variance = np.maximum(np.diagonal(model.fit.covariance(), axis1=1, axis2=2), 1e-300)
        deviance.append(clipped(model.held_out.residuals.impacts / np.sqrt(variance)) ** 2 + np.log(variance))
    return np.asarray(deviance[0] - deviance[1])


def locate_gap(experiment: Experiment, data: Data, attribution: Attribution) -> list[Cell]:
    """The gap by phase, zone, block and channel, largest share first. A flight belongs to the zone below its middle, a
    rest to the zone below its end.

    The shares of the significant places sum to 1; if none is significant, those of all places. Where blocks come to
    rest follows from their impacts and is not a part of the gap. It is listed only if nothing else is significant."""
    ground, blocks, parts = (experiment.cross_section, list(experiment.blocks), [_impact_part(data, attribution)])
    if isinstance(data, FilmData):
        parts.append(_flight_part(data, attribution, ground))
        if len((rests := find_rests(data)).flight) and len(data.impacts):
            parts.append(_rest_part(data, attribution, ground, rests))
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
                        place = part.phase, ground.zone_names[int(z)], blocks[int(b)], channel
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


@dataclass
class Rests:
    """Ends of the films: last flight of each, recorded time from its start to the end of the film in s, and final
    pose."""

    flight: Array
    wait_s: Array
    pose: Array


def find_rests(data: FilmData) -> Rests:
    """Ends of the releases that touch the ground after their last flight."""
    film, flights = data.film, data.flights
    last = np.setdiff1d(np.arange(len(flights)), flights.follows)
    ends = np.searchsorted(film.release, flights.release[last], side="right")
    use = (ends - flights.last[last] > 3 * REST_FRAMES) & np.isfinite(data.start_s[last])
    last, ends = last[use], ends[use]
    pose = np.array([film.pose[end - REST_FRAMES : end].mean(axis=0) for end in ends]).reshape(-1, 3)
    middle = np.array([film.t_s[end - REST_FRAMES : end].mean() for end in ends])
    return Rests(last, middle - data.flights.middle[last] - data.start_s[last], pose)


def rest_squares(data: FilmData, rests: Rests, fit: Fit, variance: Array) -> Array:
    """(n, 3) squares of simulated - measured x, y, theta at the end, over their variance; clipped."""
    residuals = _residuals(data, rests, _world(data, rests, fit, fit.p))
    return clipped(residuals / np.sqrt(variance)) ** 2


def rest_variance(data: FilmData, rests: Rests, fit: Fit) -> Array:
    """(n, 3) variances of the ends, from the noise of the last flights and the soil's scatter."""
    world = _world(data, rests, fit, fit.p)
    at = _residuals(data, rests, world)
    variance = np.repeat(data.film.long_noise[None] ** 2, len(rests.flight), axis=0)
    for k, sigma in enumerate(fit.scatter[: len(BASE_WIDTH)]):
        p = fit.p + DIFFERENCE_STEP * (np.arange(len(fit.p)) == k)
        stepped = _residuals(data, rests, _world(data, rests, fit, p))
        variance += np.nan_to_num((stepped - at) * sigma / DIFFERENCE_STEP) ** 2
    start = data.start_s[rests.flight]
    states = data.states_at(world, rests.flight, start)
    noise = data.true_covariance(world, rests.flight, start, states)
    for k in range(N_STATE):
        sigma_state = np.sqrt(noise[:, k, k])
        stepped = _residuals(data, rests, world, sigma_state[:, None] * (np.arange(N_STATE) == k))
        variance += np.nan_to_num(stepped - at) ** 2
    variance[data.unknown_spin[rests.flight] > 0.0, THETA] = np.inf
    return variance


def _world(data: FilmData, rests: Rests, fit: Fit, p: Array) -> World:
    return fit.model.world(p, data.order[data.flights.release[rests.flight]])


def _residuals(data: FilmData, rests: Rests, world: World, shift: Array | float = 0.0) -> Array:
    """(n, 3) simulated - recorded pose at the end of the film."""
    block, wait_s = data.flights.block[rests.flight], rests.wait_s * world.view.time_scale
    starts = data.states_at(world, rests.flight, data.start_s[rests.flight]) + shift
    samples = run_world(world, starts, block, time_limit_s=wait_s + 1e-9, times_s=wait_s[:, None]).samples
    return world.view.record(centroid_poses(world, block, samples))[:, 0] - rests.pose
