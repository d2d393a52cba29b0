"""Optimal partition of the frames of one release into flights, rests and contact, compiled; `flights` prepares them.

A flight is a range of frames on one parabola; a rest is a range of frames with a fixed pose; all other frames are
contact. The cost is chi-square plus a fixed cost for each segment, so that the noise decides, not a threshold on speed.
Accelerations of a flight are free within a prior, so that drag, a tilted camera or a wrong scale do not split it."""

from typing import NamedTuple

import numpy as np

from rock2d.compiled import njit

CONTACT, FLIGHT, REST = 0, 1, 2
SEGMENT_COST = 25.0  # decrease of chi-square that one more flight or rest must give
CONTACT_FRAME_COST = 9.0  # chi-square of a contact frame; a frame of a flight has 3 on average
ACCELERATION_SD = 0.15  # prior, 1 sigma, of a flight's acceleration about gravity, in units of gravity
SPIN_ACCELERATION_SD = 3.0  # the same of its angular acceleration, in units of 1 rad per (sqrt(size / g))²


class TimeSums(NamedTuple):
    """Sums over the frames of a segment: their number and the powers 1 to 4 of the time."""

    n: int
    t1: float
    t2: float
    t3: float
    t4: float


class DataSums(NamedTuple):
    """Sums over the frames of a segment: the data times the powers 0 to 2 of the time, and the squared data."""

    y0: float
    y1: float
    y2: float
    yy: float


@njit
def _parabola_cost(time, data, mean, prior):
    """Smallest chi-square of y = a + b t + c t² with c ~ N(mean, prior²), from `TimeSums` and `DataSums` of data with
    unit variance."""
    n, s1, s2, s3, s4 = time
    y0, y1, y2, yy = data
    # subtract the mean curvature
    z0, z1, z2 = y0 - mean * s2, y1 - mean * s3, y2 - mean * s4
    zz = yy - 2.0 * mean * y2 + mean * mean * s4
    w = s4 + 1.0 / (prior * prior)
    # Gram-Schmidt on 1, t, t²
    m1 = s1 / n
    v11 = s2 - s1 * m1
    c2, v12 = s2 / n, s3 - s2 * m1
    r = zz - z0 * z0 / n
    u1 = z1 - m1 * z0
    if v11 <= 0.0:
        return r
    r -= u1 * u1 / v11
    v22 = w - s2 * c2 - v12 * v12 / v11
    u2 = z2 - c2 * z0 - v12 / v11 * u1
    if v22 > 0.0:
        r -= u2 * u2 / v22
    return max(r, 0.0)


@njit
def _sums(t, data):
    """Prefix sums of t^k (k 1 to 4), data t^k (k 0 to 2) and data²; data is (n, 3), unit variance."""
    n = t.size
    ts, ds = np.zeros((n + 1, 4)), np.zeros((n + 1, 12))
    for i in range(n):
        p = 1.0
        for k in range(4):
            p *= t[i]
            ts[i + 1, k] = ts[i, k] + p
        for c in range(3):
            d, p = data[i, c], 1.0
            for k in range(3):
                ds[i + 1, 4 * c + k] = ds[i, 4 * c + k] + d * p
                p *= t[i]
            ds[i + 1, 4 * c + 3] = ds[i, 4 * c + 3] + d * d
    return ts, ds


@njit
def partition(t, data, curvature, curvature_sd, fewest_frames):
    """Divide n frames into flights, rests and contact.

    t : (n,) time in s from the first frame
    data : (n, 3) x, y, theta in units of their noise
    curvature, curvature_sd : (3,) half the acceleration that the prior of a flight expects, and its 1 sigma, in units
        of noise / s²
    fewest_frames : fewest frames of a flight or rest
    Returns (n,) kind of each frame and (n,) number of its segment (-1 for contact)."""
    n = t.size
    ts, ds = _sums(t, data)
    best = np.full(n + 1, np.inf)
    came, kind = np.zeros(n + 1, np.int64), np.zeros(n + 1, np.int64)
    best[0] = 0.0
    alive = np.empty(n + 1, np.int64)
    m = 0
    for j in range(1, n + 1):
        best[j], came[j], kind[j] = best[j - 1] + CONTACT_FRAME_COST, j - 1, CONTACT
        if j >= fewest_frames:
            alive[m] = j - fewest_frames
            m += 1
        kept = 0
        for a in range(m):
            i = alive[a]
            count = j - i
            time = TimeSums(count, ts[j, 0] - ts[i, 0], ts[j, 1] - ts[i, 1], ts[j, 2] - ts[i, 2], ts[j, 3] - ts[i, 3])
            flight, rest = 0.0, 0.0
            for c in range(3):
                k = 4 * c
                sums = DataSums(
                    ds[j, k] - ds[i, k],
                    ds[j, k + 1] - ds[i, k + 1],
                    ds[j, k + 2] - ds[i, k + 2],
                    ds[j, k + 3] - ds[i, k + 3],
                )
                flight += _parabola_cost(time, sums, curvature[c], curvature_sd[c])
                rest += max(sums.yy - sums.y0 * sums.y0 / count, 0.0)
            cost = min(flight, rest)
            if best[i] + cost + SEGMENT_COST < best[j]:
                best[j] = best[i] + cost + SEGMENT_COST
                came[j], kind[j] = i, FLIGHT if flight <= rest else REST
            # a start that costs more than contact up to here can never be the best later
            if best[i] + cost <= best[j]:
                alive[kept] = i
                kept += 1
        m = kept
    kinds, numbers = np.zeros(n, np.int64), np.full(n, -1)
    j, number = n, 0
    while j > 0:
        i = came[j]
        if kind[j] != CONTACT:
            kinds[i:j], numbers[i:j] = kind[j], number
            number += 1
        j = i
    return kinds, np.where(numbers >= 0, number - 1 - numbers, -1)
