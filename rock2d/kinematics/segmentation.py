"""Where a filmed release is cut into flights and rests, by optimal partition, compiled.

A flight is a stretch of frames that one parabola explains, a rest one that a fixed pose explains; what neither
explains at a fair price is contact. The price is chi-square, so noise decides, not a threshold on speed. The
accelerations of a flight are free within a prior, so that drag, a tilted camera or a wrong scale do not cut it.
"""

from __future__ import annotations

import numpy as np

from rock2d.compiled import njit

CONTACT, FLIGHT, REST = 0, 1, 2
STRETCH_PRICE = 25.0  # chi-square that a further flight or rest must save
FRAME_PRICE = 9.0  # chi-square of a frame that nothing explains; a good frame costs 3
LOOSE = 0.15  # prior, 1 sigma, of a flight's acceleration about gravity, in units of gravity
SPIN_LOOSE = 3.0  # the same of its angular acceleration, in units of 1 rad per (sqrt(size / g))²


@njit
def _fit_cost(n, s1, s2, s3, s4, y0, y1, y2, yy, mean, prior):
    """Smallest chi-square of y = a + b t + c t² with c ~ N(mean, prior²); sums are over unit-variance data."""
    # take out the mean curvature
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
def partition(t, data, curvature, loose, shortest):
    """Cut n frames into flights, rests and contact.

    t : (n,) time in s from the first frame
    data : (n, 3) x, y, theta in units of their noise
    curvature, loose : (3,) half the acceleration that a flight has by prior, and its 1 sigma, in units of noise / s²
    shortest : fewest frames of a flight or rest
    Returns (n,) kind of each frame and (n,) number of its stretch (contact counts as none: -1).
    """
    n = t.size
    ts, ds = _sums(t, data)
    best = np.full(n + 1, np.inf)
    came, kind = np.zeros(n + 1, np.int64), np.zeros(n + 1, np.int64)
    best[0] = 0.0
    alive = np.empty(n + 1, np.int64)
    m = 0
    for j in range(1, n + 1):
        best[j], came[j], kind[j] = best[j - 1] + FRAME_PRICE, j - 1, CONTACT
        if j >= shortest:
            alive[m] = j - shortest
            m += 1
        kept = 0
        for a in range(m):
            i = alive[a]
            count = j - i
            s1, s2 = ts[j, 0] - ts[i, 0], ts[j, 1] - ts[i, 1]
            s3, s4 = ts[j, 2] - ts[i, 2], ts[j, 3] - ts[i, 3]
            flight, rest = 0.0, 0.0
            for c in range(3):
                y0, y1 = ds[j, 4 * c] - ds[i, 4 * c], ds[j, 4 * c + 1] - ds[i, 4 * c + 1]
                y2, yy = ds[j, 4 * c + 2] - ds[i, 4 * c + 2], ds[j, 4 * c + 3] - ds[i, 4 * c + 3]
                flight += _fit_cost(count, s1, s2, s3, s4, y0, y1, y2, yy, curvature[c], loose[c])
                rest += max(yy - y0 * y0 / count, 0.0)
            cost = min(flight, rest)
            if best[i] + cost + STRETCH_PRICE < best[j]:
                best[j] = best[i] + cost + STRETCH_PRICE
                came[j], kind[j] = i, FLIGHT if flight <= rest else REST
            # a start that is dearer than contact from here on will never be the best again
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
