"""Distortion of flights by a lens: residuals of the parabolas, compared with a radial distortion.

A picture with distortion k shows true (1 + k ρ²), with ρ over half the diagonal of the picture. A parabola absorbs most
of this; only its residuals distinguish a lens from another scale. Only long flights across the picture therefore give
an accurate k. Flights of 10 frames at 30 frames per second give a standard error of about 0.04, as large as the
distortion of a phone."""

import numpy as np

from rock2d.arrays import Array
from rock2d.kinematics.flight_gravity import PARABOLA_TERMS, Measured
from rock2d.kinematics.flights import Film, Flights
from rock2d.records.columns import POSITION
from rock2d_tracking.camera import PixelMap

LENS_ROUNDS = 4  # in which places without the lens are found
CLEAR_ERRORS = 5.0  # least k in standard errors
LEAST_EXPLAINED = 0.3  # least share of the squared residuals that the lens must explain


def lens_distortion(film: Film, flights: Flights, camera: PixelMap, size_px: tuple[int, int]) -> Measured | None:
    """Distortion k that explains the residuals of the parabolas of flights; None if it is not significant.

    camera : map of the places in the film, without distortion
    size_px : (width, height) of the picture"""
    middle = 0.5 * (np.array(size_px) - 1.0)
    parts = list(zip(flights.first, flights.last, strict=True))
    freedom = sum(2 * (last - first - PARABOLA_TERMS) for first, last in parts) - 1
    if freedom < 1:
        return None
    off = camera.to_pixel(film.pose[:, POSITION]) - middle
    left = _without_parabolas(film, parts, off)
    true, k = off, 0.0
    for _ in range(LENS_ROUNDS):
        share = (true**2).sum(axis=1, keepdims=True) / (middle**2).sum()
        radial = _without_parabolas(film, parts, share * true)
        k = float(radial @ left) / float(radial @ radial)
        true = off / (1.0 + k * share)
    squares, explained = float(left @ left), k * float(radial @ left)
    found = Measured(k, float(np.sqrt((squares - explained) / freedom / (radial @ radial))))
    clear = abs(k) > CLEAR_ERRORS * found.error and explained > LEAST_EXPLAINED * squares
    return found if clear else None


def _without_parabolas(film: Film, parts: list[tuple[int, int]], places: Array) -> Array:
    """Residuals of the parabola of each flight, of places (frames, 2), flattened."""
    found = []
    for first, last in parts:
        t_s = film.t_s[first:last]
        own = np.linalg.qr(np.vander((t_s - t_s.mean()) / np.ptp(t_s), PARABOLA_TERMS))[0]
        found.append((places[first:last] - own @ (own.T @ places[first:last])).ravel())
    return np.concatenate(found)
