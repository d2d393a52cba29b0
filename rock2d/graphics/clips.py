"""Clips: the simulated or measured motion of one block, for videos."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from rock2d.arrays import Array
from rock2d.errors import InputError
from rock2d.graphics.palette import MEASURED_COLOUR
from rock2d.records.columns import POSE_NAMES, TIME
from rock2d.records.track import Track

if TYPE_CHECKING:
    import pandas as pd

    from rock2d.scene.blocks import Block

STEP_S = 1e-3
MOST_BRIDGED_FRAMES = 6.0  # consecutive lost frames through which a block is still drawn


@dataclass(frozen=True)
class Clip:
    """The motion of one block for drawing.

    Attributes
    ----------
    block : name of the block
    t_s, x_m, y_m, theta_rad : (n,) samples, times not decreasing; interpolated linearly
    label, colour : text of the legend and "#rrggbb" (default: name and colour of the block)
    max_gap_s : between samples farther apart than this (lost frames) the block is hidden
    body : the block that is drawn (default: the one with the name `block`)"""

    block: str
    t_s: Array
    x_m: Array
    y_m: Array
    theta_rad: Array
    label: str = ""
    colour: str = ""
    max_gap_s: float = np.inf
    body: Block | None = None

    def pose(self, t_s: float) -> tuple[float, float, float] | None:
        """x_m, y_m, theta_rad at a time. None before the first sample and where frames are lost; the last pose after
        the last sample."""
        t = self.t_s
        if t_s < t[0] - 1e-9:
            return None
        i = int(np.clip(np.searchsorted(t, t_s, side="right") - 1, 0, len(t) - 1))
        j = min(i + 1, len(t) - 1)
        if t_s > t[i] + 1e-9 and t[j] > t_s + 1e-9 and t[j] - t[i] > self.max_gap_s:
            return None
        x, y, theta = (float(np.interp(t_s, t, a)) for a in (self.x_m, self.y_m, self.theta_rad))
        return x, y, theta

    def path(self, start_s: float, end_s: float) -> list[Array]:
        """The path of the centroid between two times: pieces (n, 2) in m, interrupted where frames are lost."""
        start, end = max(start_s, float(self.t_s[0])), min(end_s, float(self.t_s[-1]))
        if end <= start:
            return []
        inside = slice(np.searchsorted(self.t_s, start, side="right"), np.searchsorted(self.t_s, end))
        t = np.concatenate([[start], self.t_s[inside], [end]])
        points = np.column_stack([np.interp(t, self.t_s, self.x_m), np.interp(t, self.t_s, self.y_m)])
        if not np.isfinite(self.max_gap_s):
            return [points]
        i = np.clip(np.searchsorted(self.t_s, 0.5 * (t[:-1] + t[1:]), side="right") - 1, 0, len(self.t_s) - 2)
        lost = self.t_s[i + 1] - self.t_s[i] > self.max_gap_s
        pieces = np.split(np.arange(len(t)), np.flatnonzero(lost) + 1)
        shown = [p for p in pieces if len(p) > 1]
        return [points[p] for p in shown]


def clip_from_track(track: Track, *, body: Block | None = None, colour: str = "") -> Clip:
    """A clip of a simulated release, sampled every STEP_S and at every knot. The error of linear interpolation is
    g STEP_S² / 8, about a micrometre."""
    start, end = float(track.knots[0, TIME]), track.end_s
    count = int(np.ceil((end - start) / STEP_S)) + 1
    t = np.union1d(np.linspace(start, end, max(count, 2)), track.knots[:, TIME])
    states = track.states(t)
    return Clip(track.block, t, states[:, 0], states[:, 1], states[:, 2], colour=colour, body=body)


def clip_from_measured(rows: pd.DataFrame) -> Clip:
    """A clip of one filmed release from its rows `block, t_s, x_m, y_m, theta_rad`.

    Gaps of lost frames (missing rows or empty cells) up to MOST_BRIDGED_FRAMES frame intervals are interpolated.
    Raises InputError if fewer than two frames are measured, or the rows belong to several releases."""
    if rows[[c for c in ("release", "block") if c in rows]].drop_duplicates().shape[0] > 1:
        raise InputError("a clip shows one release of one block; the rows given hold several")
    seen = rows[["t_s", *POSE_NAMES]].dropna().sort_values("t_s").to_numpy(float)
    if len(seen) < 2:
        name = rows["release"].iloc[0] if len(rows) and "release" in rows else "(no rows)"
        raise InputError(f"release {name} has {len(seen)} measured frames, at least 2 are needed")
    frame_s = float(np.median(np.diff(seen[:, 0])))
    t, x, y, theta = seen.T
    block, gap = str(rows["block"].iloc[0]), (MOST_BRIDGED_FRAMES + 1e-3) * frame_s
    return Clip(block, t, x, y, np.unwrap(theta), "measured", MEASURED_COLOUR, gap)
