"""The gap of predictions: the errors of whole segments of held-out releases, with and without causes.

Fits compare only the first instants after an impact. A segment continues: blocks bounce again, roll and come to rest.
So these are the errors to expect of `rock2d predict` for another film of the set-up."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from rock2d.arrays import Array
from rock2d.diagnosis.cross_validation import Validated, folds
from rock2d.diagnosis.data import FilmData
from rock2d.diagnosis.derivatives import square_roots, times_normal
from rock2d.diagnosis.learnt import Learnt
from rock2d.diagnosis.learnt_prediction import predicted_poses
from rock2d.diagnosis.replay import Segments, with_drawn_soils
from rock2d.records.columns import THETA
from rock2d.statistics import NORMAL_95

TAIL_PERCENTILE = 95.0  # percentile of the errors that is their tail
REPLICATES = 4  # replicates of each segment, for the floor
DRAWS = 400  # bootstrap draws of the releases
MOST_UNCERTAIN = 0.15  # standard error above which a closed share is not stated
# ratio to the tail without a change from which on the change is harmful; bootstrap draws of the releases differ less
HARMFUL_TAIL = 1.02


@dataclass
class PredictedGap:
    """Prediction errors (misses) of the n segments of a film: root mean square over frames and channels, in units of
    the camera's noise.

    Attributes
    ----------
    release : (n,) index of the release
    base, augmented : (n,) misses of the base law and of the diagnosed model, each fitted to other releases
    floor : (REPLICATES, n) misses if the diagnosed model were exact: from the noise of the measured state before the
        segment, the scatter of the soil, and the noise of the frames
    noise : (3,) noise of a frame, in m, m, rad
    ends : for both models, median errors at the ends of the segments: position in mm, angle in degrees (NaN if no angle
        was measured)"""

    release: Array
    base: Array
    augmented: Array
    floor: Array
    noise: Array
    ends: tuple[tuple[float, float], ...]

    def content(self, seed: int) -> dict[str, Any]:
        """The key `predicted` of diagnosis.json; `seed` of the bootstrap over releases.

        A share is not stated if the gap is so small, or the releases so few, that it is hardly known."""
        base, augmented = (self._medians(own, seed) for own in (self.base, self.augmented))
        floor = np.minimum(self._medians(self.floor.T, seed), augmented)
        closed = closed_share(base, augmented, floor)
        low, high = np.quantile(closed[1:], [0.025, 0.975])
        known = (high - low) / (2.0 * NORMAL_95) <= MOST_UNCERTAIN
        tail = {
            name: float(np.percentile(own, TAIL_PERCENTILE))
            for name, own in (("base", self.base), ("augmented", self.augmented))
        }
        return {
            "typical": {
                "base": float(base[0]), "augmented": float(augmented[0]), "floor": float(floor[0]),
                "closure": float(closed[0]) if known else None, "closure_ci95": [float(low), float(high)],
            },
            "tail": tail,
            "units": {"mm": 1e3 * float(self.noise[0]), "deg": float(np.rad2deg(self.noise[THETA]))},
        }  # fmt: skip

    def _medians(self, values: Array, seed: int) -> Array:
        """(1 + DRAWS,) medians of `values` (n, ...): of all releases, and of bootstrap draws of them."""
        rng = np.random.default_rng(np.random.SeedSequence(seed))
        rows = [np.flatnonzero(self.release == r) for r in np.unique(self.release)]
        medians = [np.median(values)]
        for _ in range(DRAWS):
            drawn = rng.integers(len(rows), size=len(rows))
            medians.append(np.median(values[np.concatenate([rows[i] for i in drawn])]))
        return np.array(medians, float)


def closed_share(base: Array, augmented: Array, floor: Array) -> Array:
    """Shares of gaps of predictions that are closed, from medians of misses (any shape); 0 without a gap. No model can
    reach less than the floor, so it is at most the miss of the augmented one."""
    gap = base - np.minimum(floor, augmented)
    return np.divide(base - augmented, gap, out=np.zeros_like(gap), where=gap > 0.0)


def predicted_gap(data: FilmData, base: Validated, learnt: Learnt, seed: int) -> PredictedGap | None:
    """The gap of the segments of a film; None if it has none."""
    segments = Segments.of(data)
    if not len(segments):
        return None
    film = measured(data, segments)
    first = held_out_poses(data, segments, base)
    last = held_out_poses(data, segments, learnt)
    return PredictedGap(
        segments.release, misses(data, first, film), misses(data, last, film),
        replicate_misses(data, segments, learnt, seed), data.film.noise,
        (end_misses(segments, off(first, film)), end_misses(segments, off(last, film))),
    )  # fmt: skip


def end_misses(segments: Segments, difference: Array) -> tuple[float, float]:
    """Median distance in mm and angle in degrees at the last frames, from differences of poses (n, k, 3)."""
    last = difference[np.arange(len(difference)), [len(rows) - 1 for rows in segments.frames]]
    turn = np.abs(last[:, THETA])
    turn = turn[np.isfinite(turn)]
    distance = np.hypot(*last[:, :THETA].T)
    return 1e3 * float(np.median(distance)), float(np.rad2deg(np.median(turn))) if len(turn) else np.nan


def without_harmful_changes(data: FilmData, learnt: Learnt, base: Validated) -> Learnt:
    """Remove the last learnt changes as long as they are harmful: they increase the median error of held-out segments,
    or the tail above those of the base law and of the model without the change."""
    segments = Segments.of(data)
    if not learnt.changes or not len(segments):
        return learnt
    current = _held_out_misses(data, segments, learnt)
    base_tail = _tail(_held_out_misses(data, segments, base))
    while learnt.before is not None:
        previous = _held_out_misses(data, segments, learnt.before)
        if _tail(current) <= HARMFUL_TAIL * max(_tail(previous), base_tail) and np.median(current) <= np.median(
            previous
        ):
            break
        learnt, current = learnt.before, previous
    return learnt


def _tail(misses: Array) -> float:
    return float(np.percentile(misses, TAIL_PERCENTILE))


def _held_out_misses(data: FilmData, segments: Segments, model: Validated) -> Array:
    return misses(data, held_out_poses(data, segments, model), measured(data, segments))


def held_out_poses(data: FilmData, segments: Segments, validated: Validated) -> Array:
    """(n, k, 3) poses of the segments, each predicted by the fit without its fold."""
    poses = np.full((*segments.instants_s.shape, 3), np.nan)
    fold, model = folds(data)[segments.release], validated.fit.model
    for k, p in enumerate(validated.held_out.parameters):
        held = segments.only(fold == k)
        if len(held):
            world = model.world(p, data.order[held.release])
            changes = validated.changes_at(p) if isinstance(validated, Learnt) else ()
            poses[fold == k] = predicted_poses(data, held, world, changes)
    return poses


def measured(data: FilmData, segments: Segments) -> Array:
    """(n, k, 3) poses of the segments in the film, NaN beyond the last frame; angles that were not measured are NaN."""
    poses = np.full((*segments.instants_s.shape, 3), np.nan)
    for i, rows in enumerate(segments.frames):
        poses[i, : len(rows)] = data.film.pose[rows]
    poses[~data.film.angle_known[segments.release], :, THETA] = np.nan
    return poses


def off(poses: Array, reference: Array) -> Array:
    """Differences of poses (..., 3), without full turns: a picture does not show them."""
    difference = poses - reference
    difference[..., THETA] = np.remainder(difference[..., THETA] + np.pi, 2.0 * np.pi) - np.pi
    return np.asarray(difference)


def misses(data: FilmData, poses: Array, reference: Array) -> Array:
    """(n,) root mean square differences `off` of two sets of poses (n, k, 3) in units of noise, where `reference` is
    not NaN."""
    return np.sqrt(np.nanmean((off(poses, reference) / data.film.noise) ** 2, axis=(1, 2)))


def replicate_misses(data: FilmData, segments: Segments, learnt: Learnt, seed: int) -> Array:
    """(REPLICATES, n) misses of the model for segments drawn from the model itself."""
    fit, order = learnt.fit, data.order[segments.release]
    world, changes = fit.model.world(fit.p, order), learnt.changes
    expected = predicted_poses(data, segments, world, changes)
    seen = np.where(np.isfinite(measured(data, segments)), expected, np.nan)
    dt = data.start_s[segments.flight]
    starts = data.states_at(world, segments.flight, dt)
    root = square_roots(data.true_covariance(world, segments.flight, dt, starts))
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    misses_of_draws = []
    for _ in range(REPLICATES):
        shift, drawn = times_normal(root, rng), with_drawn_soils(fit, world, len(segments), rng)
        poses = predicted_poses(data, segments, drawn, changes, shift)
        poses += rng.normal(size=poses.shape) * data.film.noise
        misses_of_draws.append(misses(data, poses, seen))
    return np.array(misses_of_draws)
