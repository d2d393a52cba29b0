"""Gravity of a film before the segmentation: acceleration in windows of frames in which a block surely falls."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rock2d.arrays import Array
from rock2d.files.experiment import Experiment
from rock2d.kinematics.flights import Film
from rock2d.records.columns import POSITION, X, Y

WINDOWS = (768, 384, 192, 96, 64, 48, 32, 20, 12)  # lengths in frames of the windows for fits of parabolas
FEWEST_WINDOWS = 20  # fewest windows of one length
CLEAR_CURVATURE = 8.0  # least curvature in standard errors
UNBIASED_CURVATURE = 12.0  # curvature in standard errors at which the selection of clear windows has no bias
FEWEST_FALLING_RELEASES = 3  # fewest releases whose accelerations agree
AGREEING_SPREAD = 0.1  # largest relative spread of the accelerations of free flights
FREE_FALL_SPREAD = 0.03  # the same if noise hides the stated gravity
LEAST_FALL_SLOPE = 5.0  # steepness of a path, down over along; no ground is so steep
# ratio of recorded to stated gravity in a film whose lengths and times may be right
GRAVITY_RATIO = (0.6, 1.6)


class _Falls(NamedTuple):
    """Windows in which a block surely flies: accelerations (n, 2), standard errors (n,), releases (n,)."""

    acceleration: Array
    error: Array
    release: Array

    def only(self, use: Array) -> _Falls:
        """Some of the windows, given as a mask."""
        return _Falls(*(values[use] for values in self))


class _Mode(NamedTuple):
    """Acceleration (2,) of most windows of one length, its relative spread, its clearness in standard errors, and the
    number of releases that show it."""

    acceleration: Array
    spread: float
    clearness: float
    releases: int


def window_gravity(experiment: Experiment, film: Film) -> Array | None:
    """(2,) acceleration in m/s² of blocks in free flight; None if too few fly, or if their accelerations disagree.

    A short window may be a smooth part of an impact. Therefore the result is a mode over the windows of one length, and
    of all lengths the narrowest mode, because free flights agree with each other."""
    clear: list[_Mode] = []  # of windows in which noise does not hide the stated gravity
    every: list[_Mode] = []
    for window in WINDOWS:
        falls = _falls(film, window)
        seen = experiment.gravity_m_s2 > CLEAR_CURVATURE * falls.error
        clear += _agreeing(falls.only(seen), AGREEING_SPREAD)
        every += _agreeing(falls, FREE_FALL_SPREAD)
    modes = clear or every
    unbiased = [mode for mode in modes if mode.clearness > UNBIASED_CURVATURE]
    return min(unbiased or modes, key=lambda mode: mode.spread).acceleration if modes else None


def _agreeing(falls: _Falls, largest_spread: float) -> list[_Mode]:
    """The mode of windows of one length, if enough of them agree."""
    if len(falls.error) < FEWEST_WINDOWS:
        return []
    mode = _mode(falls)
    return [mode] if mode.spread < largest_spread and mode.releases >= FEWEST_FALLING_RELEASES else []


def _mode(falls: _Falls) -> _Mode:
    """Mode of accelerations along y, the median of the closest quarter of them, or of the closest ten."""
    falls = falls.only(np.argsort(falls.acceleration[:, Y]))
    n = len(falls.error)
    k = max(n // 4, min(n, 10))
    y = falls.acceleration[:, Y]
    width = y[k - 1 :] - y[: n - k + 1]
    first = int(np.argmin(width))
    closest = slice(first, first + k)
    mode = np.asarray(np.median(falls.acceleration[closest], axis=0))
    size = abs(mode[Y])
    aside = np.median(np.abs(falls.acceleration[closest, X] - mode[X]))
    releases = len(np.unique(falls.release[closest]))
    return _Mode(mode, float(max(width[first], aside) / size), float(size / np.median(falls.error)), releases)


def _falls(film: Film, window: int) -> _Falls:
    """The windows of frames that lie on a clearly curved parabola.

    A sliding or rolling block may move as smoothly as a flying one, but straight along the ground. So the path must be
    bent, or steeper than any ground."""
    start = np.arange(0, len(film.t_s) - window, max(window // 2, 1))
    start = start[film.release[start] == film.release[start + window - 1]]
    frames = start[:, None] + np.arange(window)
    t = film.t_s[frames]
    t = t - t.mean(axis=1, keepdims=True)
    path = film.pose[frames][..., POSITION]
    cubic = (t**3).mean(axis=1, keepdims=True) / (t**2).mean(axis=1, keepdims=True) * t
    square = t**2 - (t**2).mean(axis=1, keepdims=True) - cubic
    a = 2 * np.einsum("wf,wfc->wc", square, path) / (square**2).sum(axis=1)[:, None]
    v = np.einsum("wf,wfc->wc", t, path) / (t**2).sum(axis=1)[:, None]
    fitted = path.mean(axis=1)[:, None] + v[:, None] * t[..., None] + 0.5 * a[:, None] * square[..., None]
    error = 2 * film.noise[Y] / np.sqrt((square**2).sum(axis=1))
    rough = np.sqrt(((path - fitted) ** 2).mean(axis=1)) / film.noise[POSITION]
    bend = np.abs(v[:, X] * a[:, Y] - v[:, Y] * a[:, X]) / np.maximum(np.hypot(*v.T), 1e-12)
    steep = np.abs(v[:, Y]) > LEAST_FALL_SLOPE * np.abs(v[:, X])
    curved = (bend > CLEAR_CURVATURE * error) | steep
    use = (rough.max(axis=1) < 1.4) & curved & (np.abs(a[:, Y]) > CLEAR_CURVATURE * error)
    return _Falls(a[use], error[use], film.release[start[use]])
