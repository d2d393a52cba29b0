"""Flights, impacts and frames for the live view of a diagnosis, measured and predicted by several models."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from rock2d.diagnosis.cross_validation import Validated
from rock2d.diagnosis.data import FilmData
from rock2d.diagnosis.diagnose import Diagnosis
from rock2d.diagnosis.gap import typical_size, zone_below
from rock2d.diagnosis.likelihood import standard_deviations
from rock2d.diagnosis.replay import Segments
from rock2d.diagnosis.report.tables import corrected_setup, signs_of, touch_places
from rock2d.diagnosis.residual_regression import FLIGHT_DEGREES, clipped
from rock2d.graphics.live_data import packed, packed_columns
from rock2d.kinematics.impacts import ground_axes
from rock2d.records.columns import LINEAR_VELOCITY, OMEGA, POSITION, THETA, X

Array = np.ndarray

# the largest move of a block between shown frames, and the share of the frames in which it is kept
SHOWN_MOVE_RADII, FAST = 0.25, 0.9
WORST_SHARE = 0.25  # if not all releases are shown, share of those that the base law misses most
IMPACT, FLIGHT = range(2)
PHASES = ("impact", "flight")
IMPACT_UNITS = (("m/s", "mm"), ("m/s", "mm"), ("rad/s", "°"))
FLIGHT_UNITS = (("mm",), ("mm",), ("°",))
IN_UNIT = {"m/s": 1.0, "rad/s": 1.0, "mm": 1e3, "°": 180.0 / np.pi}


@dataclass
class Items:
    """The n impacts and flights of a film, impacts first, and their residuals in each of k models.

    Attributes
    ----------
    phase, release, block, zone : (n,) indices
    t_s, until_s : (n,) time since the beginning of the release: for an impact the end of the previous and the beginning
        of the next flight; for a flight its middle
    place_m : (n, 2) position of the centroid
    incident, outgoing : (n, 3) measured velocities of impacts along and across the ground, and spin; else NaN
    squares : (k, n, 3, c) squares of the residuals of the three channels, in standard deviations, clipped
    misses : (k, n, 3, 2) residuals of the channels in SI: of impacts rates and poses; of flights their bend, root mean
        square over frames, and NaN
    """

    phase: Array
    release: Array
    block: Array
    zone: Array
    t_s: Array
    until_s: Array
    place_m: Array
    incident: Array
    outgoing: Array
    squares: Array
    misses: Array

    def __len__(self) -> int:
        return len(self.phase)

    @property
    def sigma(self) -> Array:
        """(k, n) root mean square of the residuals over the channels, in standard deviations."""
        return np.asarray(np.sqrt(self.squares.mean(axis=(2, 3))))

    @classmethod
    def of(cls, result: Diagnosis, data: FilmData, models: Sequence[Validated]) -> Items:
        """All impacts and flights, with residuals on held-out releases."""
        found, impacts, flights = result.found, data.impacts, data.flights
        assert found is not None
        setup, film, middle = corrected_setup(result), data.film, data.basis.middle
        began = film.t_s[np.searchsorted(film.release, np.arange(len(data.order)))]
        ends = film.t_s[flights.last[impacts.before] - 1]
        before = data.states_at(setup, impacts.before, ends - middle[impacts.before])
        after = data.states_at(setup, impacts.after, impacts.begin_s)
        velocities = [
            np.column_stack([*ground_axes(impacts.tangent, own[:, LINEAR_VELOCITY]), own[:, OMEGA]])
            for own in (before, after)
        ]
        aloft = data.states(setup).middle
        fitted = found.final.fit.model.world(found.final.fit.p, data.impact_order)
        below = zone_below(result.experiment.cross_section, data.states(fitted).middle[:, X])
        middles = middle - began[flights.release]
        after_s = middle[impacts.after] + impacts.begin_s - began[impacts.release]
        none = np.full((len(flights), 3), np.nan)
        squares, misses = zip(*(_squares_and_misses(result, data, own) for own in models), strict=True)
        return cls(
            np.repeat([IMPACT, FLIGHT], [len(impacts), len(flights)]),
            np.concatenate([impacts.release, flights.release]), np.concatenate([impacts.block, flights.block]),
            np.concatenate([impacts.zone, below]),
            np.concatenate([ends - began[impacts.release], middles]), np.concatenate([after_s, middles]),
            np.concatenate([touch_places(result, data), aloft[:, POSITION]]),
            np.concatenate([velocities[0], none]), np.concatenate([velocities[1], none]),
            np.array(squares), np.array(misses),
        )  # fmt: skip

    def channels(self, phase: int, block: int | None, zone: int | None) -> tuple[int, list[list[str]]]:
        """Number of the impacts or flights of a block in a zone (None: all); and in words for each model, for all
        channels together and then each channel: typical residual, with the median misses of the channel."""
        own = self.phase == phase
        own &= (block is None or self.block == block) & (zone is None or self.zone == zone)
        units = (IMPACT_UNITS, FLIGHT_UNITS)[phase]
        if not own.any():
            return 0, [["-"] * len(self.squares)] * (1 + len(units))
        together = [f"{typical_size(squares[own].reshape(own.sum(), -1)):.1f} σ" for squares in self.squares]
        each = [
            [
                f"{typical_size(squares[own, c]):.1f} σ ({_median_words(misses[own, c], of)})"
                for squares, misses in zip(self.squares, self.misses, strict=True)
            ]
            for c, of in enumerate(units)
        ]
        return int(own.sum()), [together, *each]

    def table(self, keep: Array) -> dict[str, Any]:
        """Rows of the items in the mask `keep` (n,), as 32-bit numbers column by column: measured values; then for each
        model the size of the residual in σ, the misses in mm and degrees, and the predicted velocities."""
        measured = [self.release, self.block, self.zone, self.phase, self.t_s, self.until_s, *self.place_m.T]
        columns = [*measured, *self.incident.T, *self.outgoing.T]
        shown = [IN_UNIT["mm"], IN_UNIT["mm"], IN_UNIT["°"]]
        for sigma, misses in zip(self.sigma, self.misses, strict=True):
            poses = np.where((self.phase == IMPACT)[:, None], misses[..., 1], misses[..., 0]) * shown
            columns += [sigma, *poses.T, *(self.outgoing + misses[..., 0]).T]
        raw = np.array(columns)[:, keep].astype("<f4").tobytes()
        return {"rows": packed(raw), "count": int(keep.sum()), "measured": len(measured)}


def _median_words(misses: Array, units: Sequence[str]) -> str:
    """Medians of misses (n, 2) in their units."""
    sizes = [
        np.abs(own[np.isfinite(own)]) * IN_UNIT[unit] for own, unit in zip(misses.T, units, strict=False)
    ]
    said = [f"{np.median(own):.2g}" if len(own) else "-" for own in sizes]
    return ", ".join(f"{value} {unit}".replace(" °", "°") for value, unit in zip(said, units, strict=True))


def _squares_and_misses(result: Diagnosis, data: FilmData, own: Validated) -> tuple[Array, Array]:
    """`squares` and `misses` of a model."""
    assert result.found is not None
    residuals = own.held_out.residuals
    z = clipped(residuals.impacts / standard_deviations(result.found.final.fit.covariance()))
    bends = clipped(residuals.flights[:, :, :FLIGHT_DEGREES])
    poses, rates = residuals.impacts.reshape(-1, 2, 3).swapaxes(0, 1)
    bend = np.sqrt((residuals.flights[:, :, :FLIGHT_DEGREES] ** 2).sum(axis=2))
    bend *= data.film.long_noise * data.basis.level[:, None]
    squares = np.concatenate([z.reshape(-1, 2, 3).swapaxes(1, 2) ** 2, bends**2])
    misses = np.stack([rates, poses], axis=2), np.stack([bend, np.full_like(bend, np.nan)], axis=2)
    return squares, np.concatenate(misses)


def channel_words(items: Items, blocks: int, zones: int) -> list[list[list[Any]]]:
    """`Items.channels` of both phases for all blocks, then each block; for all zones, then each zone."""
    return [
        [[items.channels(phase, b, z) for phase in (IMPACT, FLIGHT)] for z in (None, *range(zones))]
        for b in (None, *range(blocks))
    ]


def shown_releases(items: Items, count: int, share: float) -> Array:
    """(count,) mask of a share of the releases: those that the base law misses most, and the first ones."""
    if share >= 1.0:
        return np.ones(count, bool)
    most = max(int(share * count), 1)
    size = np.zeros(count)
    np.maximum.at(size, items.release, items.sigma[0])
    worst = np.argsort(-size, kind="stable")[: math.ceil(WORST_SHARE * most)]
    others = np.setdiff1d(np.arange(count), worst)[: most - len(worst)]
    shown = np.zeros(count, bool)
    shown[worst] = shown[others] = True
    return shown


def frames_table(
    result: Diagnosis, data: FilmData, segments: Segments, poses: Sequence[Array], shown: Array
) -> dict[str, Any]:
    """Frames of the `shown` releases (releases,): instant and measured pose, and for each model how far the predicted
    pose is off; 0 outside the segments. The first and the last frame of each segment are always included."""
    film, signs, models = data.film, np.array(signs_of(result)), len(poses)
    off, segment = np.zeros((len(film.t_s), models, 3)), np.full(len(film.t_s), -1)
    kept = np.zeros(len(film.t_s), bool)
    first = np.searchsorted(film.release, np.arange(len(data.order)))
    step = frame_step(result, data)
    kept[(np.arange(len(kept)) - first[film.release]) % step == 0] = True
    for i, rows in enumerate(segments.frames):
        segment[rows] = i
        kept[rows[[0, -1]]] = True
        for m, own in enumerate(poses):
            off[rows, m] = np.nan_to_num(own[i, : len(rows)] - film.pose[rows])
    off *= signs
    off[~film.angle_known[film.release], :, THETA] = 0.0
    kept &= shown[film.release]
    own = np.flatnonzero(kept)
    values = np.column_stack([
        film.t_s[own] - film.t_s[first[film.release[own]]], film.pose[own] * signs, off[own].reshape(len(own), -1),
    ])  # fmt: skip
    raw, scales = packed_columns(values)
    releases, counts = np.unique(film.release[own], return_counts=True)
    runs = np.flatnonzero(np.diff(segment[own], prepend=-2, append=-2) != 0)
    return {
        "rows": packed(raw), "scales": scales, "counts": counts.tolist(), "release": releases.tolist(),
        "segments": [[int(a), int(b)] for a, b in pairwise(runs) if segment[own[a]] >= 0],
    }  # fmt: skip


def frame_step(result: Diagnosis, data: FilmData) -> int:
    """Number k if every k-th frame is shown."""
    film = data.film
    same = np.diff(film.release) == 0
    moved = np.hypot(*np.diff(film.pose[:, :2], axis=0)[same].T)
    radii = np.array([block.radius_m for block in result.experiment.blocks.values()])
    moved /= radii[film.release_block[film.release[1:][same]]]
    return max(int(SHOWN_MOVE_RADII / max(float(np.quantile(moved, FAST)), 1e-6)), 1)
