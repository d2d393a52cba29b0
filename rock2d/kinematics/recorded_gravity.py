"""Gravity as a film shows it: the acceleration of blocks in free flight."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rock2d.files.experiment import Experiment
from rock2d.kinematics.flights import Film
from rock2d.records.columns import POSITION, Y

Array = np.ndarray

WINDOWS = (768, 384, 192, 96, 64, 48, 32, 20, 12)  # frames of the parabolas from which gravity is read
FEWEST_WINDOWS = 20  # of one length
CLEAR_CURVATURE = 8.0  # standard errors
UNBIASED_CURVATURE = 12.0  # standard errors from which on the clear windows are all windows
CREDIBLE_SPREAD = 3.0  # times that of the length whose windows agree best
FREE_FALL_SPREAD = 0.03  # largest relative spread of accelerations that can only be those of free flights
LEAST_RATIO, LARGEST_RATIO = (
    0.6,
    1.6,
)  # of recorded and stated gravity in a film whose lengths and times may be right


class _Mode(NamedTuple):
    """Acceleration (2,) of most windows of one length, its relative spread and its clearness in standard errors."""

    acceleration: Array
    spread: float
    clearness: float


def recorded_gravity(experiment: Experiment, film: Film) -> Array | None:
    """(2,) acceleration in m/s² of the frames that lie on a curved parabola; None if too few do.

    A short window may be the smooth turn of an impact, a long one a slide. So the mode over the windows of one length
    counts, and of all lengths the mode nearest to gravity. But free flights agree with each other: if no mode near
    gravity is as narrow as the narrowest ones, lengths or times are wrong, and the narrowest mode is returned.
    """
    stated = max(experiment.gravity_m_s2, 1e-9)
    found: list[_Mode] = []
    beyond: list[_Mode] = []
    for window in WINDOWS:
        a, error = _curvatures(film, window)
        clear = np.abs(a[:, Y]) > CLEAR_CURVATURE * error
        seen = (
            experiment.gravity_m_s2 > CLEAR_CURVATURE * error
        )  # stated gravity would not be lost in the noise
        for use, modes in ((clear & seen, found), (clear, beyond)):
            if use.sum() >= FEWEST_WINDOWS:
                modes.append(_mode(a[use], error[use]))
    if not found:
        found = [mode for mode in beyond if mode.spread < FREE_FALL_SPREAD]
    if not found:
        return None
    ratio = np.array([abs(mode.acceleration[Y]) / stated for mode in found])
    spread = np.array([mode.spread for mode in found])
    near = (ratio > LEAST_RATIO) & (ratio < LARGEST_RATIO) & (spread <= CREDIBLE_SPREAD * spread.min())
    if near.any():
        return found[int(np.argmin(np.abs(np.log(ratio))))].acceleration
    unbiased = [mode for mode in found if mode.clearness > UNBIASED_CURVATURE]
    return min(unbiased or found, key=lambda mode: mode.spread).acceleration


def _mode(a: Array, error: Array) -> _Mode:
    """Mode of vectors (n, 2) along y, the median of the closest quarter of them, or of the closest ten."""
    a = a[np.argsort(a[:, Y])]
    k = max(len(a) // 4, min(len(a), 10))
    width = a[k - 1 :, Y] - a[: len(a) - k + 1, Y]
    first = int(np.argmin(width))
    mode = np.asarray(np.median(a[first : first + k], axis=0))
    size = abs(mode[Y])
    return _Mode(mode, float(width[first] / size), float(size / np.median(error)))


def _curvatures(film: Film, window: int) -> tuple[Array, Array]:
    """Accelerations (n, 2) of the windows of frames in which a block moves smoothly, and standard errors (n,) of their
    y component."""
    start = np.arange(0, len(film.t_s) - window, max(window // 2, 1))
    start = start[film.release[start] == film.release[start + window - 1]]
    frames = start[:, None] + np.arange(window)
    t = film.t_s[frames]
    t = t - t.mean(axis=1, keepdims=True)
    pose = film.pose[frames]
    cubic = (t**3).mean(axis=1, keepdims=True) / (t**2).mean(axis=1, keepdims=True) * t
    square = t**2 - (t**2).mean(axis=1, keepdims=True) - cubic
    a = 2 * np.einsum("wf,wfc->wc", square, pose) / (square**2).sum(axis=1)[:, None]
    v = np.einsum("wf,wfc->wc", t, pose) / (t**2).sum(axis=1)[:, None]
    fitted = pose.mean(axis=1)[:, None] + v[:, None] * t[..., None] + 0.5 * a[:, None] * square[..., None]
    error = 2 * film.noise[Y] / np.sqrt((square**2).sum(axis=1))
    rough = np.sqrt(((pose - fitted) ** 2).mean(axis=1)) / film.noise
    smooth = rough[:, POSITION].max(axis=1) < 1.4
    return a[smooth, POSITION], error[smooth]
