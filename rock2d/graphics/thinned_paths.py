"""The paths of many releases with few points, for the data of a page.

A flight needs two points: with gravity and the time between them they define its parabola. Contacts, and flights that
are nearly straight, are simplified as polylines in time (Douglas and Peucker 1973)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rock2d.arrays import Array
from rock2d.graphics.live_data import packed, packed_columns
from rock2d.records.columns import INSTANT_X, INSTANT_Y, TIME
from rock2d.records.track import Track

TYPICAL_SPEED_M_S = 10.0  # converts time to length where polylines in time are simplified
TRACKS_PER_BATCH = 500


@dataclass(frozen=True)
class ThinnedPaths:
    """Points of paths, one path after the other.

    Attributes
    ----------
    instants : (n, 3) t_s, x_m, y_m
    arc : (n,) bool, True if the path from this point to the next is a parabola, False if it is a straight line
    counts : (paths,) points of each path"""

    instants: Array
    arc: Array
    counts: Array

    def subset(self, wanted: Sequence[int]) -> ThinnedPaths:
        """The paths with these numbers, in their order here."""
        chosen = np.zeros(len(self.counts), bool)
        chosen[list(wanted)] = True
        kept = np.repeat(chosen, self.counts)
        return ThinnedPaths(self.instants[kept], self.arc[kept], self.counts[chosen])

    def packed(self) -> tuple[str, list[list[float]]]:
        """The points as text (the bytes of `packed_columns`, then `arc`), and the minimum and the range of t_s, x_m
        and y_m."""
        rows, scales = packed_columns(self.instants)
        return packed(rows + self.arc.astype(np.uint8).tobytes()), scales


def thinned_paths(tracks: Sequence[Track], tolerance_m: float) -> ThinnedPaths:
    """The simplified paths of tracks (at least one).

    The error is mostly below `tolerance_m`, and up to three times that where blocks are fast."""
    parts = [_thinned(tracks[i : i + TRACKS_PER_BATCH], tolerance_m) for i in range(0, len(tracks), TRACKS_PER_BATCH)]
    return ThinnedPaths(*(np.concatenate([getattr(p, name) for p in parts]) for name in ("instants", "arc", "counts")))


def _thinned(tracks: Sequence[Track], tolerance_m: float) -> ThinnedPaths:
    instants = np.concatenate([track.knots[:, [TIME, INSTANT_X, INSTANT_Y]] for track in tracks])
    sizes = np.array([len(track.knots) for track in tracks])
    in_flight = np.concatenate([np.append(track.flight[: len(track.knots) - 1], False) for track in tracks])
    duration_s = np.append(np.diff(instants[:, 0]), 0.0)
    gravity = np.repeat([track.gravity_m_s2 for track in tracks], sizes)
    arc = in_flight & (gravity * duration_s**2 / 8.0 > tolerance_m)  # the parabola's height above its chord
    last = np.zeros(len(instants), bool)
    last[np.cumsum(sizes) - 1] = True
    run = np.concatenate([[0], np.cumsum((arc | last)[:-1])])  # knots between two parabolas
    kept = _polyline_vertices(instants, run, tolerance_m)
    path = np.repeat(np.arange(len(tracks)), sizes)
    return ThinnedPaths(instants[kept], arc[kept], np.bincount(path[kept], minlength=len(tracks)))


def _polyline_vertices(instants: Array, run: Array, tolerance_m: float) -> Array:
    """Which vertices of polylines to keep, (n,) bool; the ends are kept.

    `instants` (n, 3) are the vertices, `run` (n,) the number of the polyline of each."""
    import shapely

    kept = np.bincount(run)[run] <= 2
    rest = np.flatnonzero(~kept)
    if not len(rest):
        return kept
    _, line = np.unique(run[rest], return_inverse=True)
    t, x, y = instants[rest].T
    for coordinate in (x, y):  # the third coordinate of the lines tells which vertices remain
        lines = shapely.linestrings(np.column_stack([TYPICAL_SPEED_M_S * t, coordinate, rest]), indices=line)
        remain = shapely.simplify(lines, tolerance_m, preserve_topology=False)
        kept[shapely.get_coordinates(remain, include_z=True)[:, 2].astype(np.int64)] = True
    return kept
